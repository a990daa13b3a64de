"""From a motor that nobody knows to parameters in its drive: what is to be found out, in which order, and by what.

* `first_start` - pole pairs, phase order, direction and angle offset, by a small current that turns with a forced angle
* `trial` - steps of speed and currents, and an excited motor, recorded; `response` - the mean step; `promise` - what a
  tuning says of it; `loops` - the one against the other; `excitation` - how a motor is excited
* `proposal` - the set that follows from a diagnosis, the shaft and tuning rules
* `identify` - all of that, one after the other; `results` - as plain values; `report` - as a page
* `commissionings` - those of a service

Knows nothing of HTTP.
"""
