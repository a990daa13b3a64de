"""The twin: a machine with any set of effects, by equations that no emulator shares.

* `model` - the machine with effects, and what it leaves of a recording's voltage
* `response` - how what a bridge loses answers a small change of a model
* `currents` - the currents simulated from a recording's voltages, speed and angle

Knows nothing of how a model is found.
"""
