"""What an encoder's counts and Hall sensors' edges leave of the angle, and the smoothest rotor that they allow.

* `smoothest_course` - the course through the counts; `rotor_movement` - what torque and the turn's orders add to it
* `angle_rounding` - the rounding that is left, and the energy it hides
* `hall_edges` - an angle that goes by edges and their times, and the course through them

Knows nothing of effects.
"""
