"""A parameter set for other tools, and from them.

* `dcf` - the device configuration file of CANopen tools (CiA 306), out and in
* `c_header` - a header of a firmware in C: floats, or fixed point with base values
* `a2l` - a fragment for calibration tools (ASAM MCD-2 MC)

Knows nothing of drives that are connected.
"""
