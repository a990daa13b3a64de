"""Iron loss: current that makes neither flux nor torque, in a branch beside the magnetising one.

    i = i_m + i_i        R_i i_i + lag R_c d(i_i)/dt = e = d(psi)/dt        R_i = R_c |omega_e| / (|omega_e| + omega_h)

conductance = 1/R_c is that of eddy currents, with a loss of 3/2 |omega_e psi|^2 / R_c; omega_h the speed at which
hysteresis loses as much; lag the time the field takes to enter a lamination. Only i_m makes flux, so a measured current
that carries i_i implies too much of it:

    u = ... - balance of L i_i

The branch lets pulses through as they come, so i_i is followed pulse by pulse. S. Morimoto, Y. Tong, Y. Takeda,
T. Hirasa, "Loss minimization control of permanent magnet synchronous motor drives", IEEE Trans. Industrial
Electronics, 1994.
"""

import numpy as np

from estimator.kernel import kernel
from estimator.physics.effect import Effect, Parameter, Sizes, constant
from estimator.physics.rows import AXES, Real, Rows, Vector

_SLOWEST = 10.0  # rad/s electrical, below which hysteresis grows no further


def voltage(rows: Rows, sizes: Sizes) -> Vector:
    """Added voltage, V."""
    conductance = sizes[0]
    i_i = conductance * _driven(rows, sizes) * rows.rotor.conj()
    m = rows.machine
    return -rows.balance(m.L_d * i_i.real + 1j * m.L_q * i_i.imag)


def _driven(rows: Rows, sizes: Sizes) -> Vector:
    _, omega_h, lag = sizes
    return rows.once(f"iron {omega_h!r} {lag!r}", lambda: branch(rows, omega_h, lag))


def branch(rows: Rows, omega_h: float, lag: float, *, behind_R_s: bool = True) -> Vector:
    """Current times R_c, V, at samples in the stationary frame, of a branch at the flux, or at the terminals."""
    speed = np.abs(rows.omega_e) + _SLOWEST
    share = speed / (speed + omega_h)  # R_i / R_c
    x = rows.T_s * share / lag
    lost = (rows.machine.R_s if behind_R_s else 0.0) * rows.i_mean * rows.middle
    if rows.u_dc is None:
        fed = (1.0 - np.exp(-x)) * (rows.u * rows.middle - lost)
    else:
        fed = -(1.0 - np.exp(-x)) * lost
        for k, axis in enumerate(AXES):
            d = rows.duties[:, k]
            pulse = np.exp(-0.5 * x * (1.0 - d)) - np.exp(-0.5 * x * (1.0 + d))
            fed += 2.0 / 3.0 * axis * rows.u_dc * pulse
    return _followed(fed / share, np.exp(-x))


@kernel
def _followed(fed: Vector, kept: Real) -> Vector:
    i = np.empty(len(fed) + 1, np.complex128)
    i[0] = fed[0] / (1.0 - kept[0])
    for k in range(len(fed)):
        i[k + 1] = kept[k] * i[k] + fed[k]
    return i


EFFECT = Effect(
    "iron_loss", "iron loss",
    (
        Parameter("conductance", "S", lambda rows: 0.03 * rows.i_rated / emf(rows), constant(0.0)),
        Parameter("omega_h", "rad/s", lambda rows: 0.5 * fastest(rows), constant(0.0),
                  lambda rows: 3.0 * fastest(rows), shape=True),
        Parameter("lag", "s", constant(1e-4), constant(2e-5), constant(1e-3), shape=True),
    ),
    voltage,
    lambda rows: tuple((part * fastest(rows), lag) for part in (0.05, 0.7) for lag in (7e-5, 1.5e-4)),
    "u_d too high by speed squared times L_q psi_f / R_c, without load",
    ("angle_offset", "q_axis_saturation"),
    told=lambda _rows, p: {"R_c": (1.0 / max(p[0], 1e-12), "ohm"), "omega_h": (p[1], "rad/s"), "lag": (p[2], "s")},
    missed=1e-3,
    remembers=_driven,
)  # fmt: skip


def fastest(rows: Rows) -> float:
    """The highest electrical speed, rad/s."""
    return max(float(np.max(np.abs(rows.omega_e), initial=0.0, where=rows.joined)), 1.0)


def emf(rows: Rows) -> float:
    """The magnets' voltage at it, V."""
    return fastest(rows) * rows.machine.psi_f
