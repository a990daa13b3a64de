"""The Modbus client, TCP and RTU: registers for values, a window of registers for rows and recordings.

* `turns` - a lock that starves nobody
* `line` - one unit on a line: the one file that knows pymodbus
* `drive` - the client

Knows nothing of the other transports.
"""
