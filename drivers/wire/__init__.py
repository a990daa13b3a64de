"""What the drive's manual would say: every signal, its address, type, unit and scale, once.

Clients (`drivers`) and the virtual drive (`emulator`) both stand on this room; everything here is data
and pure functions. It knows nothing of sockets, buses, clocks or physics.

* `dictionary` - the signals
* `codec` - bytes of one signal to SI and back
* `cia402` - the state machine's words, error codes; `memory` - what is told of the memory for parameters
* `canopen_od` - CANopen's view: identifiers, PDO layouts, the EDS
* `uart_frame`, `uart_url` - the UART's view: frames, their payloads, the line's address
* `modbus_map` - Modbus's view: the registers; `modbus_url` - where a Modbus drive is
"""
