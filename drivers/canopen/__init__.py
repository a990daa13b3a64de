"""The CANopen client: SDO for values, TPDOs for the stream.

* `assembler` - frames to rows; `answers` - whether one node alone answers; both pure
* `socketcand` - a CAN bus behind a TCP port: bytes to frames, many at once
* `bus` - one node on a bus: the one file that knows canopen and python-can
* `drive` - the client

Knows nothing of the other transports.
"""
