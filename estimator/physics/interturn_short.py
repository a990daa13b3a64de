"""A short between turns: a loop in one phase that its back-EMF drives.

    i = i_m + g e_k a_k        e_k = voltage across phase k, as the loop's current follows it, a_k its axis

The loop's current adds to that of the phase and makes neither useful flux nor a drop of the phase's resistance outside
the shorted turns; g is its conductance as seen from the phase, 2/3 of the squared share of turns over the loop's
resistance. The loop turns 3/2 g e_k^2 into heat, in the winding. Beside unequal phase resistances the voltages across
the phases have a mean, that of excess_k i_k, which the terminals do not show. A winding that warms up raises a part of
the loop's resistance, `copper`, and g falls.
B. Vaseghi, N. Takorabet, F. Meibody-Tabar, "Fault analysis and parameter identification of permanent-magnet motors by
the finite-element method", IEEE Trans. Magnetics 45(9), 2009, doi 10.1109/TMAG.2009.2022156.
"""

import numpy as np

from estimator.arrays import Array, Vector
from estimator.physics.effect import Branch, Parameter, Sizes, constant
from estimator.physics.iron_loss import emf, iron_branch, voltage_followed
from estimator.physics.rows import Rows
from estimator.physics.vectors import AXES, by_phase


def voltage(rows: Rows, sizes: Sizes) -> Vector:
    """Added voltage, V."""
    loop, phase = _loop(rows, sizes), round(sizes[1]) % 3
    mean = rows.stationary(0.5 * (loop[:-1] + loop[1:]))
    R_k = (rows.machine.R_s + by_phase(*rows.R_s_excess)[phase]) * rows.R_s_ratio
    return -R_k * mean - rows.balance(rows.flux_of_little(loop * rows.rotor.conj()))


def _loop(rows: Rows, sizes: Sizes) -> Vector:
    """The loop's current, A at samples in the stationary frame."""
    axis, along = _along(rows, sizes)
    return np.asarray(_conductance(rows, sizes) * along * axis, np.complex128)


def _conductance(rows: Rows, sizes: Sizes) -> Array | float:
    """S, at samples."""
    ratio = rows.R_s_ratio
    if not isinstance(ratio, np.ndarray):
        return sizes[0]
    warmer = 0.5 * (np.append(ratio, ratio[-1:]) + np.append(ratio[:1], ratio)) - 1.0
    return sizes[0] / (1.0 + sizes[3] * warmer)


def _loop_voltage(rows: Rows, sizes: Sizes) -> Vector:
    """The loop's current, A at samples in the rotor frame."""
    return _loop(rows, sizes) * rows.rotor.conj()


def _loop_falls(rows: Rows, sizes: Sizes) -> Vector:
    """Voltage (V, at samples) that would make a current fall as the loop's does where the winding is short."""
    return rows.flux_of_little(_loop_voltage(rows, sizes)) / sizes[2]


def _loop_heat(rows: Rows, sizes: Sizes) -> Array:
    """Squared current (A^2, at samples) that R_s would make the loop's loss of, less what the loop spares the phase."""
    axis, along = _along(rows, sizes)
    lost: Array = sizes[0] * along**2 / rows.machine.R_s
    return lost + np.abs(rows.i_s - sizes[0] * along * axis) ** 2 - np.abs(rows.i_s) ** 2


def _along(rows: Rows, sizes: Sizes) -> tuple[complex, Array]:
    """The phase's axis, and the voltage along it (V, at samples) as the loop's current follows it."""
    axis, (along, mean) = AXES[round(sizes[1]) % 3], _loop_driven(rows, sizes)
    return axis, (along * axis.conjugate()).real + mean


def _loop_driven(rows: Rows, sizes: Sizes) -> tuple[Vector, Array | float]:
    """Voltages (V, at samples) as a loop's current follows them: the terminals', and the mean of the three phases'."""
    lag = sizes[2]
    along = rows.once(iron_branch, 0.0, lag, behind_R_s=False)
    if not any(rows.R_s_excess):
        return along, 0.0
    return along, rows.once(_mean_followed, lag)


def _mean_followed(rows: Rows, lag: float) -> Array:
    """The mean of the three phases' voltages (V, at samples) as the loop's current follows it."""
    return voltage_followed(rows, lag, _mean_drop(rows))


def _mean_drop(rows: Rows) -> Array:
    """Mean (V, of each period) of what unequal resistances drop in the three phases."""
    mean: Array = 0.5 * (complex(*rows.R_s_excess).conjugate() * rows.i_mean * rows.middle).real
    return mean * rows.R_s_ratio


EFFECT = Branch(
    "interturn_short", "a short between turns",
    (
        Parameter("conductance", "S", lambda rows: 0.03 * rows.i_rated / emf(rows), lambda _: 0.0),
        Parameter("phase", "1", constant(1.0), constant(0.0), constant(2.0), shape=True, discrete=True),
        Parameter("lag", "s", constant(1e-4), constant(2e-5), constant(5e-4), shape=True),
        Parameter("copper", "1", constant(0.5), constant(0.02), constant(1.0), shape=True),
    ),
    lambda _rows: tuple((phase, 1e-4, 0.5) for phase in (0.0, 1.0, 2.0)),
    "current of twice the electrical frequency in the rotor frame that grows with speed, without load too",
    ("iron_loss", "current_sensor_gain"),
    adds=voltage,
    told=lambda _rows, p: {"conductance": (p[0], "S"), "phase": (p[1], "1")},
    discrepancy=1e-4,
    remembers=_loop_driven,
    beside=_loop_voltage,
    emf=_loop_falls,
    sees_voltage=True,
    heats=_loop_heat,
)  # fmt: skip
