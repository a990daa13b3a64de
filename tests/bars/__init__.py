"""What is measured by name: `python -m tests.bars.NAME` prints a table; `make` has a target for most."""
