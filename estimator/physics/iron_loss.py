"""Iron loss: current that makes neither flux nor torque, in a branch beside the magnetising one.

    i = i_m + i_i        R_i i_i + lag R_c d(i_i)/dt = e = d(psi)/dt        R_i = R_c |omega_e| / (|omega_e| + omega_h)

conductance = 1/R_c is that of eddy currents, with a loss of 3/2 |omega_e psi|^2 / R_c; omega_h the speed at which
hysteresis loses as much; lag the time the field takes to enter a lamination. Only i_m makes flux, so a measured current
that carries i_i implies too much of it:

    u = ... - balance of L i_i

The branch lets pulses through as they come, so i_i is followed pulse by pulse; what the bridge loses of them it does
not see. To fast changes it is an inductance of R_c lag beside the machine's. S. Morimoto, Y. Tong, Y. Takeda,
T. Hirasa, "Loss minimization control of permanent magnet synchronous motor drives", IEEE Trans. Industrial
Electronics, 1994.
"""

import math

import numpy as np

from estimator.arrays import Array, Vector
from estimator.kernel import kernel
from estimator.physics.effect import Branch, Parameter, Sizes, constant
from estimator.physics.rows import Rows
from estimator.physics.vectors import AXES

_SLOWEST = 10.0  # rad/s electrical, below which hysteresis grows no further


def voltage(rows: Rows, sizes: Sizes) -> Vector:
    """Added voltage, V."""
    conductance = sizes[0]
    i_i = conductance * _iron_driven(rows, sizes) * rows.rotor.conj()
    return -rows.balance(rows.flux_of_little(i_i))


def _iron_driven(rows: Rows, sizes: Sizes) -> Vector:
    _, omega_h, lag = sizes
    return rows.once(iron_branch, omega_h, lag)


def iron_branch(rows: Rows, omega_h: float, lag: float, *, behind_R_s: bool = True) -> Vector:
    """Current times R_c, V, at samples in the stationary frame, of a branch at the flux, or at the terminals."""
    speed = np.abs(rows.omega_e) + _SLOWEST
    share = speed / (speed + omega_h)  # R_i / R_c
    x = rows.T_s * share / lag
    lost = (rows.machine.R_s if behind_R_s else 0.0) * rows.R_s_ratio * rows.i_mean * rows.middle
    if rows.lost is not None:
        lost = lost + rows.lost * rows.middle
    if rows.u_dc is None:
        return _branch_course(x, share, rows.u * rows.middle - lost, np.zeros((0, 3)), np.zeros(0))
    return _branch_course(x, share, -lost, rows.duties, rows.u_dc)


def voltage_followed(rows: Rows, lag: float, v: Array) -> Array:
    """A voltage (V, of each period) at samples, as the current of a branch that lags so follows it."""
    x = np.full(len(rows), rows.T_s / lag)
    return _branch_course(x, np.ones(len(rows)), v.astype(np.complex128), np.zeros((0, 3)), np.zeros(0)).real


@kernel
def _branch_course(x: Array, share: Array, steady: Vector, duties: Array, u_dc: Array) -> Vector:
    """The branch's current from period to period: fed by a steady voltage, and by the legs' pulses where known."""
    i = np.empty(len(x) + 1, np.complex128)
    for k in range(len(x)):
        kept = math.exp(-x[k])
        fed = (1.0 - kept) * steady[k]
        for leg in range(duties.shape[1] if len(duties) else 0):
            late = math.exp(-0.5 * x[k] * (1.0 - duties[k, leg]))
            fed += 2.0 / 3.0 * AXES[leg] * u_dc[k] * (late - kept / late)
        fed /= share[k]
        if k == 0:
            i[0] = fed / (1.0 - kept)
        i[k + 1] = kept * i[k] + fed
    return i


EFFECT = Branch(
    "iron_loss", "iron loss",
    (
        Parameter("conductance", "S", lambda rows: 0.03 * rows.i_rated / emf(rows), constant(0.0)),
        Parameter("omega_h", "rad/s", lambda rows: 0.5 * fastest(rows), constant(0.0),
                  lambda rows: 3.0 * fastest(rows), shape=True),
        Parameter("lag", "s", constant(1e-4), constant(2e-5), constant(1e-3), shape=True),
    ),
    lambda rows: tuple((part * fastest(rows), lag) for part in (0.05, 0.7) for lag in (7e-5, 1.5e-4)),
    "u_d too high by speed squared times L_q psi_f / R_c, without load",
    ("angle_offset", "q_axis_saturation"),
    adds=voltage,
    told=lambda _rows, p: {"R_c": (1.0 / max(p[0], 1e-12), "ohm"), "omega_h": (p[1], "rad/s"), "lag": (p[2], "s")},
    discrepancy=1e-4,
    fast_stiffness=lambda p: p[0] / p[2],
    remembers=_iron_driven,
    sees_voltage=True,
)  # fmt: skip


def fastest(rows: Rows) -> float:
    """The highest electrical speed, rad/s, that lasts for three periods: one wrong angle is none."""
    speed = np.where(rows.joined, np.abs(rows.omega_e), 0.0)
    lasting = np.minimum(np.minimum(speed[2:], speed[1:-1]), speed[:-2])
    return max(float(np.max(lasting, initial=0.0)), 1.0)


def emf(rows: Rows) -> float:
    """The magnets' voltage at it, V."""
    return fastest(rows) * rows.machine.psi_f
