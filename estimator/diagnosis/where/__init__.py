"""Where a mismatch is: in speed, current, time, angle or frequency.

* `regions` - ranges of one or two quantities; `spectra` - lines and orders
* `place` - the smallest of these that holds most of it

Knows nothing of effects.
"""
