"""The plant: what a drive is bolted to, as continuous physics under a switched or averaged supply.

* `machine` - flux linkage as state; `magnetics` - current and torque from the field's energy
* `mechanics` - the shaft; `course` - the winding's temperature over time and the parameters that follow it
* `physics` - what goes beyond the textbook, an effect a file
* `dynamics` - all of it, integrated
* `inverter`, `modulation`, `bridge` - the inverter, with its edges where a mean voltage per period is not enough
* `sensors` - what the drive measures

Knows nothing of control, scenarios and buses.
"""
