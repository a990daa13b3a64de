"""The bench: acquisition, estimation, service. `api` (REST, the page) and `cli` stand on it.

* `config` - drives and ports from TOML; `machine_file` - nominal values; `window`, `tuning` - settings of the
  estimation
* `method` - the estimator that runs: the window, and the recursion or the filter beside it
* `service` - everything that runs, as one context manager
* `acquisition` - one pump thread per drive; `estimation` - one worker with a bounded queue
* `recording` - files to samples, on `table` (formats), `sources` (columns, constants), `runs` (time base, gaps)
* `replay` - the streaming core over a recording
* `captures` - those of a service, on `capture` (one of them), `capture_request`, `capture_file` (on disk)
* `lease` - who writes to a drive; `signals` - what is read and written by name
* `errors` - what the bench itself can refuse
"""
