"""The virtual drive on real buses.

* `canopen`, `modbus`, `uart` - a server each
* `socketcand` - a CAN bus on a TCP port; `terminal` - a serial line that this process makes
* `faults` - what befalls links and the drive on them
* `link` - a server at a URL, opened again where it goes

Knows nothing of motors: a drive, its dictionary and its time.
"""
