"""What a switched bridge loses of its voltage: dead time, drops, pulses too short, each edge followed.

* `period_course` - the currents' course within a period; `legs` - what each leg loses at its edges
* `drop_course` - drops along the current's course; `lost_voltage` - all of it, as a voltage of each period

Knows nothing of effects: `physics.inverter_voltage_error` is the one that stands on it.
"""
