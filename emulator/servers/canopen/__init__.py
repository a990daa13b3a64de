"""A CANopen node over the virtual drive.

* `sdo_server` - the three transfers, frames in, frames out; `tpdo` - when each is sent and what it carries
* `objects` - the object dictionary
* `server` - the node on its bus: the one file that knows python-can
"""
