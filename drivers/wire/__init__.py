"""What the drive's manual would say: every signal, its address, type, unit and scale, once.

Clients (`drivers`) and the virtual drive (`emulator`) both stand on this room; everything here is data
and pure functions. It knows nothing of sockets, buses, clocks or physics.

* `dictionary` - the signals
* `codec` - bytes of one signal to SI and back
* `canopen_od` - CANopen's view: identifiers, PDO layouts, the EDS
"""
