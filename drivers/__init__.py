"""Clients of a drive: a URL in, blocks of SI samples out.

* `connect` - URL to `Drive`
* `drive` - the `Drive` protocol; `block` - what its stream yields; `errors` - what can go wrong
* `assembler` - frames to blocks: joins by tick, unwraps, counts gaps; pure
* `canopen_drive` - the CANopen client; `canopen_bus` - the bus beneath it; `socketcand` - whether a port serves one
* `wire` - the drive's published contract

Knows nothing of estimators, disks or HTTP. One reader thread and one lock inside a client.
"""
