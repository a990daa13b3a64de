"""The bench: drives watched, recorded, moved and diagnosed, as one service.

Read in this order:

* `errors` - what the bench itself can refuse; `expected` - what may come, and what is said of what may not
* `machine_file` - nominal values; `witness` - values measured elsewhere; `engineering` - numbers for people
* `live` - a drive's stream to estimates, and whether they may be trusted
* `recordings` - files to samples, and the streaming core over them
* `store` - what is kept: recordings of streams, the shelf of all recordings, the catalogue, the log of writes
* `parameters` - a drive's parameters as sets: made, planned, flashed, taken back
* `actions` - what is done to a drive: control, captures, recordings, experiments, flashes
* `diagnoses` - a file to a diagnosis: JSON, page, machine file
* `commissioning` - a motor that nobody knows, to parameters in its drive
* `config` - drives and ports from TOML
* `service` - everything that runs, as one context manager
* `api` - REST and the page over it; `cli` - the command line
* `files` - files of others read, new ones written whole
* `jobs` - what captures, experiments and diagnoses have in common: known by id, worked on, cancelled, waited for

Stands on `drivers` and `estimator`, and cannot tell the emulated drive from a real one.
"""
