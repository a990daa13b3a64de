"""The physics that a machine, its inverter and its sensors may have beyond the textbook, one effect a file.

Every effect's file says the equation, its source, its units and what it can be confused with.

* `vectors` - space vectors and phases; `pulses` - the ripple under a bridge's pulses
* `derived` - what is worked out of rows once; `rows` - what every effect's equation is made of, period by period
* `effect` - what an effect is, and of which kinds: it adds a voltage, changes the machine, or errs a sensor;
  `library` - all of them
* `saturation`, `magnet_flux`, `flux_map` - changes of the flux linkage, and what several effects of it share
* `temperature_course` - what follows a temperature from outside, and how it is told
* `current_sensing`, `angle_sensing` - errors of sensors, and what they share; `bridge` - what a switched bridge loses
* `convention_error` - a recording that follows another convention: no physics, but told likewise

Knows nothing of how effects are found.
"""
