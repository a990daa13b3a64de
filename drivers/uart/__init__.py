"""The UART client: framed requests and replies, multiplexed with the stream.

* `drive` - the client: the one file that opens a pyserial port

Knows nothing of the other transports.
"""
