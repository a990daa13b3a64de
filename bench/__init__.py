"""The bench: acquisition, estimation, service. `api` (REST, the page) and `cli` stand on it.

* `config` - drives and ports from TOML; `machine_file` - nominal values; `window`, `tuning` - settings of the
  estimation
* `method` - the estimator that runs: the window, and the recursion or the filter beside it
* `service` - everything that runs, as one context manager
* `acquisition` - one pump thread per drive; `estimation` - one worker with a bounded queue
* `recording` - files to samples, on `table` (formats), `sources` (columns, constants), `runs` (time base, gaps)
* `replay` - the streaming core over a recording
* `captures` - those of a service, on `capture` (one of them), `capture_request`, `capture_file` (on disk)
* `part_file` - work on disk that outlives its process; `new_file`, `input_file`, `seal` - files written whole, read,
  and checked
* `diagnose` - a file to a diagnosis, on `diagnosis_request`, `formats` (kinds of files), `report` (the page),
  `diagnosed_machine` (a machine file); `diagnosis_jobs` - those of a service, each in a process of `worker`
* `experiments` - what a drive is made to do so that a recording tells, on `experiment`, `experiment_part` (on disk)
* `watch` - over a stream, whether the model still explains the drive; `engineering` - numbers with units for people
* `lease` - who writes to a drive; `signals` - what is read and written by name
* `errors` - what the bench itself can refuse
"""
