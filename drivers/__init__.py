"""Clients of a drive: a URL in, blocks of SI samples out.

* `connect` - URL to `Drive`
* `drive` - the `Drive` protocol; `block` - what its stream yields; `errors` - what can go wrong
* `assembler` - CAN frames to rows; `rows` - rows to blocks: unwraps ticks, counts gaps; pure
* `operation` - the state machine over any drive; `capture` - its recorder: set up, trigger, resumable upload
* `canopen_drive` - the CANopen client; `canopen_bus` - the bus beneath it; `socketcand` - whether a port serves one
* `modbus_drive` - the Modbus client; `modbus_line` - the line beneath it; `turns` - a lock that starves nobody
* `wire` - the drive's published contract

Knows nothing of estimators, disks or HTTP. One reader thread and one lock inside a client.
"""
