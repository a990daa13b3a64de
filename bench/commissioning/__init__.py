"""From a motor that nobody knows to parameters in its drive: what is to be found out, in which order, and by what.

* `first_start` - pole pairs, phase order, direction and angle offset, by a small current that turns with a forced angle

Knows nothing of services and HTTP.
"""
