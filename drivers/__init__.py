"""Clients of a drive: a URL in, blocks of SI samples out.

Read in this order:

* `wire` - what the drive's manual says: signals, objects, registers, frames, URLs
* `drive` - the `Drive` protocol; `block` - what its stream yields; `errors` - what can go wrong
* `rows` - rows of counts to blocks: unwraps ticks, counts gaps, tells whether a line carries the rows asked for
* `settled` - a write whose answer was lost; `serial_port` - the end of a port
* `canopen`, `modbus`, `uart` - a client each
* `operation` - the state machine over any drive; `capture` - its recorder; `lease` - control, and its renewal
* `connect` - URL to `Drive`

Knows nothing of estimators, disks or HTTP. One reader thread and one lock inside a client.
"""
