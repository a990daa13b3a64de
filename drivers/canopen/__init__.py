"""The CANopen client: SDO for values, TPDOs for the stream.

* `assembler` - frames to rows; `answers` - whether one node alone answers; both pure
* `socketcand` - whether a TCP port serves a CAN bus
* `bus` - one node on a bus: the one file that knows canopen and python-can
* `drive` - the client

Knows nothing of the other transports.
"""
