"""The virtual drive: motor, inverter, sensors and firmware behind a real bus protocol.

* `machine`, `inverter`, `sensors`, `mechanics` - the physics; `plant` - its integration
* `modulation`, `bridge` - the inverter with its edges, where a mean voltage per period is not enough
* `course` - the winding's temperature over time and the parameters that follow it
* `firmware`, `excitation` - field-oriented control and its references; `stream` - the rows it sends
* `simulation` - all of these in one compiled loop; `virtual_drive` - that loop behind the drive's dictionary
* `canopen_server` - a CANopen node over it; `socketcand` - a CAN bus on a TCP port; `clock` - real time
* `scenarios`, `bounds` - what is emulated, from TOML or built in, and what it may be
* `frames`, `noise`, `kernel` - space vectors, random numbers, compilation

Shares no line with `estimator`: an estimator proven on its own equations proves nothing.
"""
