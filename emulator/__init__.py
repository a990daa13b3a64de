"""The virtual drive: motor, inverter, sensors and firmware behind a real bus protocol.

Read in this order:

* `plant` - what no firmware can change: machine, bridge, shaft, sensors, and the physics beyond the textbook
* `firmware` - what a drive computes once a control period
* `scenario` - what is emulated, from TOML or built in
* `drive` - plant and firmware in one compiled loop, and that loop behind the drive's dictionary
* `servers` - the drive on a CAN bus, a Modbus line, a serial line
* `conceal` - recordings in which an effect is concealed, and their answers
* `frames`, `noise`, `kernel`, `bounds` - space vectors, random numbers, compilation, what a parameter may be
* `clock` - real time; `errors`, `input_file` - what goes wrong outside, and files that others made

Shares no line with `estimator`: an estimator proven on its own equations proves nothing. Knows `drivers.wire`, the
contract, and no client.
"""
