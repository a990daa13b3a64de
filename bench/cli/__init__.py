"""The command line: `pmsm-bench COMMAND`.

* `exit_codes` - one meaning each; `terminal`, `table` - what is shown; `output` - files that a command writes
* `rest` - the service's interface as commands ask it; `options` - options whose value is several
* `doctor` - whether a bench can run here
* `commands` - a file each; `main` has them all
"""
