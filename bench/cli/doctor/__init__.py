"""Whether a bench can run here: what is looked at, what was found, what to do. Changes nothing, writes on no bus.

* `check` - one check; `processes` - who listens, who is connected, who has a device, as Linux tells it
* `machine` - versions, kernels, clock; `places` - folders, token, certificate
* `running` - the service's port, and the service that answers there; `buses` - the way to each drive
* `examination` - all of them, in order
"""
