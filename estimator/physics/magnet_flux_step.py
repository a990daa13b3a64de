"""The magnets lose flux at once: a demagnetisation by heat and field.

    psi_f(t) = psi_f (1 + change)    from `time` on

psi_f is that before. S. Ruoho, E. Dlala, A. Arkkio, "Comparison of demagnetization models for finite-element analysis
of permanent-magnet synchronous machines", IEEE Trans. Magnetics, 2007.
"""

import numpy as np

from estimator.physics.effect import Effect, Parameter, Sizes, constant
from estimator.physics.rows import Rows, Vector


def voltage(rows: Rows, sizes: Sizes) -> Vector:
    """Added voltage, V."""
    change, time = sizes
    since = rows.t >= rows.span[0] + time * rows.span[1]
    if not since.any():
        return np.zeros(len(rows), np.complex128)
    return rows.balance(change * rows.machine.psi_f * since.astype(float))


EFFECT = Effect(
    "magnet_flux_step", "a step of the magnets' flux",
    (
        Parameter("change", "1", constant(0.05), constant(-0.5), constant(0.0)),
        Parameter("time", "1", constant(0.5), constant(0.01), constant(0.99), shape=True, discrete=True),
    ),
    voltage,
    lambda _rows: tuple((k / 32.0,) for k in range(1, 32)),
    "back-EMF that is lower from one moment on",
    ("magnet_flux_drift",),
    told=lambda rows, p: {"change": (p[0], "1"), "time": (rows.span[0] + p[1] * rows.span[1], "s")},
    missed=2e-4,
)
