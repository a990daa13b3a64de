"""What an encoder's counts leave of the angle, and the smoothest rotor that they allow.

* `smoothest_course` - the course through the counts; `rotor_movement` - what torque and the turn's orders add to it
* `angle_rounding` - the rounding that is left, and the energy it hides

Knows nothing of effects.
"""
