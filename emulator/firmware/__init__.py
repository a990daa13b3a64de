"""The firmware: what the drive computes once a control period, from what it has measured.

* `excitation` - sequences around the current references; `reference` - the speed's; `weakening` - of the field
* `correction` - what it makes up for: sensors, the encoder's place, lost voltage, saturation
* `control` - current and speed control with all of these, and its protections
* `operation` - the state machine of CiA 402, faults, the watchdog

Knows of the plant what a drive knows: its sensors and its inverter's reach.
"""
