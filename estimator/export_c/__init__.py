"""The windowed estimator in C99, for a drive's own processor.

* `pmsm_window.h` - what the module takes and says; `pmsm_rows.h`, `pmsm_window.c` - samples to rows and sums;
  `pmsm_solve.c` - sums to values and statuses
* `stream` - samples that try it: a simulated drive, with a gap, a value that is no number, and a standstill
* `pmsm_check.c`, `vectors` - these as test vectors with what Python says of them, and the program that compares
* `module` - all of it as files, for a window, parameters and a type; `page.md`, the README that goes with them

Says what `online.window_ls` says of the same window, row by row of one control period. Knows nothing of the bench.
"""
