"""A speed column that is late, as a filter makes it: no physics of the machine. Where the angle is its integral, the
voltages alone can tell.

    omega_e = omega + lag d(omega)/dt

Knows neither how it is found nor how it is undone.
"""

from typing import Final

NAME: Final = "speed_lag"
TITLE: Final = "a lag of the speed column"
