"""The magnets warm up: psi_f falls within the recording.

    psi_f(t) = psi_f (1 + change h(t) / h(length))
    h(t) = 1 - (time_constant exp(-t / time_constant) - lag exp(-t / lag)) / (time_constant - lag)

NdFeB loses 0.11 % of its flux per kelvin. psi_f is that at the start, `change` the share by which it is different at
the end; with saturation beside it, see `saturation`. Magnets are warmed by what warms up before them, a housing or a
rotor's iron, with a time constant of its own, `lag`: two nodes of a thermal network. J. R. Hendershot, T. J. E.
Miller, "Design of Brushless Permanent-Magnet Machines", 2010, chapter 15.
"""

from estimator.physics.effect import Parameter, constant
from estimator.physics.magnet_flux import DRIFT
from estimator.physics.saturation import FluxChange

EFFECT = FluxChange(
    DRIFT, "drift of the magnets' flux",
    (
        Parameter("change", "1", constant(0.03), constant(-0.3), constant(0.0)),
        Parameter("time_constant", "1", constant(0.6), constant(0.05), constant(5.0), shape=True),
        Parameter("lag", "1", constant(0.01), constant(1e-3), constant(0.3), shape=True),
    ),
    lambda _rows: ((0.25, 0.01), (0.8, 0.01)),
    "back-EMF that falls with time at the same speed",
    ("magnet_flux_step", "magnet_temperature", "d_axis_saturation"),
    told=lambda rows, p: {"change": (p[0], "1"), "time_constant": (p[1] * rows.span[1], "s")},
    in_proportion_to="psi_f",
    discrepancy=2e-4,
)
