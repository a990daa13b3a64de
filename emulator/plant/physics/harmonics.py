"""Space harmonics: a magnet flux, inductances and a cogging torque that change with the rotor's angle.

    psi_m(theta_e) = psi_f (1 + d_6 cos 6 theta_e + d_12 cos 12 theta_e)
                     + j psi_f (q_6 sin 6 theta_e + q_12 sin 12 theta_e)
    1/L(theta_e) = 1/L + inductance/L_q cos 6 theta_e          on both axes
    tau_cog = -cogging sin 6 theta_e

The 5th and 7th harmonic of a phase's back-EMF are the 6th in the rotor frame, the 11th and 13th the 12th. The torque
follows from the field's energy (`magnetics`), so what ripples in the voltages ripples in the torque. D. Hanselman,
"Brushless Permanent Magnet Motor Design", 2nd ed., 2003, chapters 6 and 10.

Shows as voltage and torque ripple at six and twelve times the electrical frequency, in proportion to speed.
"""

from typing import Annotated, NamedTuple

from emulator.bounds import Bound

_SHARE = Bound(low=-0.2, high=0.2)


class Harmonics(NamedTuple):
    """Sizes."""

    d_6: Annotated[float, _SHARE] = 0.0  # of psi_f
    q_6: Annotated[float, _SHARE] = 0.0
    d_12: Annotated[float, _SHARE] = 0.0
    q_12: Annotated[float, _SHARE] = 0.0
    inductance: Annotated[float, _SHARE] = 0.0  # of 1/L_q
    cogging: Annotated[float, Bound("Nm", low=0.0)] = 0.0  # amplitude
