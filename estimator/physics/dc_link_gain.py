"""The dc link is read wrong: every voltage is scaled.

    u = u recorded / gain

It scales R_s, L_d, L_q and psi_f alike and is seen only as far as they leave their tolerance, or where something does
not scale. Trivial.
"""

from estimator.physics.effect import Effect, Parameter, Sizes, constant
from estimator.physics.rows import Rows, Vector


def voltage(rows: Rows, sizes: Sizes) -> Vector:
    """Added voltage, V."""
    (error,) = sizes
    return rows.u * (error / (1.0 + error))


EFFECT = Effect(
    "dc_link_gain", "a wrong gain of the dc link's reading",
    (Parameter("error", "1", constant(0.05), constant(-0.5), constant(0.5)),),
    voltage,
    lambda _rows: ((),),
    "all four parameters scaled alike",
    ("winding resistance", "inductances", "psi_f"),
)
