"""The magnets lose flux within milliseconds: a demagnetisation by heat and field.

    psi_f(t) = psi_f (1 + change min(max((t - time) / duration + 1/2, 0), 1))

psi_f is that before; `time` is the middle of the loss; with saturation beside it, see `saturation`. S. Ruoho, E. Dlala,
A. Arkkio, "Comparison of demagnetization models for finite-element analysis of permanent-magnet synchronous machines",
IEEE Trans. Magnetics, 2007.
"""

from estimator.physics.effect import Parameter, constant
from estimator.physics.magnet_flux import STEP
from estimator.physics.saturation import FluxChange

EFFECT = FluxChange(
    STEP, "a step of the magnets' flux",
    (
        Parameter("change", "1", constant(0.05), constant(-0.5), constant(0.0)),
        Parameter("time", "1", constant(0.5), constant(0.01), constant(0.99), shape=True, discrete=True),
        Parameter("duration", "s", constant(1e-3), constant(2e-5), constant(0.05), shape=True),
    ),
    lambda _rows: tuple((k / 32.0, 1e-3) for k in range(1, 32)),
    "back-EMF that is lower from one moment on",
    ("magnet_flux_drift", "magnet_temperature"),
    told=lambda rows, p: {
        "change": (p[0], "1"), "time": (rows.span[0] + p[1] * rows.span[1], "s"), "duration": (p[2], "s"),
    },
    in_proportion_to="psi_f",
    discrepancy=5e-5,
)
