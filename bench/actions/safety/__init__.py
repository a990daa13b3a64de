"""What keeps a drive safe while something is done with it.

* `lease` - who of this service writes to it
* `limits` - how far its set points may go
* `unfinished` - what is to be undone, on disk before it is done
* `under_control` - from control to off, and as before, however it ends

Knows nothing of what is done.
"""
