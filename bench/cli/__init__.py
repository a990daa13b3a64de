"""The command line: `pmsm-bench serve | emulate | up | estimates | capture | replay`. `main` has them all."""
