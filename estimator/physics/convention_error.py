"""A cause that is no physics: columns, or the machine's data, follow another convention than the one expected.

Expected are peak phase quantities in the rotor frame, amplitude-invariant, motor sign convention, d axis on the magnet
flux, the electrical angle at a period's start, SI units. Knows neither how an error is found nor how it is undone.
"""

from typing import Final

NAME: Final = "convention_error"
TITLE: Final = "a convention that differs from the one expected"
UNIT: Final = {
    "u_scale": "1",
    "i_scale": "1",
    "T_s_scale": "1",
    "theta_scale": "1",
    "omega_scale": "1",
    "u_angle": "rad",
    "i_angle": "rad",
    "u_shift": "1",
    "theta_shift": "1",
    "u_base": "1",
    "u_mirrored": "1",
    "i_mirrored": "1",
    "pole_pairs": "1",
    "i_a_scale": "1",
    "i_b_scale": "1",
    "i_c_scale": "1",
}
"""Parameters with their units: scales are recorded over expected, and negative for a wrong sign; angles are recorded
less expected; shifts are the rows by which a column is late; the base is that
of voltages in per unit, over the dc link; mirrored is 1 where the d and q axes were swapped or one
of them has the wrong sign, 2 where two phases were swapped; pole pairs are those that the angle was made with; scales
of one phase current are of its sensor, 0 for one that is dead."""
