"""What is done to a drive: control, captures, experiments and flashes, each under a lease.

* `safety` - leases, limits, what has to be undone
* `control` - start, stop, reset, set points; `drive_jobs` - what captures and experiments have in common;
  `moving_jobs` - what those that move a drive have
* `capture_request`, `capture`, `captures` - what is asked for, one of them, those of a service
* `flashes` - those of a service, as `bench.parameters` does them
* `experiment_part`, `experiment`, `experiments` - one on disk while it is done, one of them, those of a service

Knows nothing of HTTP and of how a diagnosis is made.
"""
