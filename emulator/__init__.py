"""The virtual drive: motor, inverter, sensors and firmware behind a real bus protocol.

* `machine`, `inverter`, `sensors`, `mechanics` - the textbook's physics; `physics` - what goes beyond it, an effect a
  file; `magnetics` - current and torque from the field's energy; `plant` - all of it, integrated
* `modulation`, `bridge` - the inverter with its edges, where a mean voltage per period is not enough
* `course` - the winding's temperature over time and the parameters that follow it
* `firmware` - field-oriented control and its protections, with `weakening` of the field, `reference` of the speed and
  `excitation`; `stream` - the rows it sends
* `simulation` - all of these in one compiled loop; `virtual_drive` - that loop behind the drive's dictionary
* `operation` - its state machine, faults and watchdog; `recorder` - its recorder
* `canopen_server` - a CANopen node over it, with `canopen_objects`, `sdo_server`, `tpdo`; `socketcand` - a CAN bus on
  a TCP port; `clock` - real time; `link` - a server at a URL, opened again where it goes; `faults` - what befalls it
* `modbus_server` - a Modbus unit over it, with `modbus_frames`, `modbus_registers`; `row_ring` - the latest rows
* `scenarios`, `effects`, `bounds` - what is emulated, from TOML or built in, and what it may be; `scenario_text` - back
  to TOML; `assembly` - made ready for the simulation; `motors` - twelve motors as published
* `conceal` - recordings in which an effect is concealed, and their answers
* `frames`, `noise`, `kernel` - space vectors, random numbers, compilation

Shares no line with `estimator`: an estimator proven on its own equations proves nothing.
"""
