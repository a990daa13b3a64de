"""The command line: `pmsm-bench serve | emulate | up | estimates | replay`. `main` has them all."""
