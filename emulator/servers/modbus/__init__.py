"""A Modbus unit over the virtual drive, TCP and RTU.

* `frames` - bytes to requests and back; `row_ring` - the latest rows of the stream; both pure
* `registers` - a request in, its answer out
* `server` - the lines it is on
"""
