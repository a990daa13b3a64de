# Two commands on a machine with Python 3.11+, venv and make: `make run`, `make test`.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/pip install --quiet --disable-pip-version-check --constraint .ci/constraints.txt

.PHONY: run test lint types arrows fast clean

run: $(VENV)/.run ## emulated drive, service and page; Ctrl-C ends them
	@exec $(BIN)/pmsm-bench up

test: lint types arrows fast ## every check

lint: $(VENV)/.dev
	$(BIN)/ruff check .

types: $(VENV)/.dev
	$(BIN)/basedpyright

arrows: $(VENV)/.dev
	$(BIN)/lint-imports --no-logo

fast: $(VENV)/.dev
	$(BIN)/pytest

$(VENV)/.run: pyproject.toml .ci/constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "pmsm-bench needs Python 3.11 or later, got " + sys.version.split()[0])'
	$(PYTHON) -m venv $(VENV)
	$(PIP) --editable .
	@touch $@

$(VENV)/.dev: $(VENV)/.run
	$(PIP) --editable ".[dev]"
	@touch $@

clean: ## remove what make made
	rm -rf $(VENV) .pytest_cache .ruff_cache .hypothesis .import_linter_cache
