"""The service: everything that runs, as one context manager.

* `signals` - a drive's signals by name; `token` - what is asked for beyond loopback
* `parameters` - what they are whenever something begins
* `service` - pumps, worker, captures, experiments, diagnoses

Knows nothing of HTTP.
"""
