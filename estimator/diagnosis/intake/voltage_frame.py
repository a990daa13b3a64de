"""Voltage frame: voltages turned on over half a period by the speed that a drive knows, not by its angle's movement.

A drive that reads an angle theta, and foresees the middle of a period from its own speed omega, records voltages in the
frame of theta + omega T/2. Where theta errs over the turn this is not the middle of two angles,

    u_recorded = u exp(-j x)        x = (omega T - D) / 2        D = theta[k+1] - theta[k]

and what is left looks like an error of the angle that turns no currents. One share of -j x u tells, beside the machine
and errors of the angle of orders 0 to 4 of the electrical turn, by least squares of the whitened flux balance. Knows no
effect.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from estimator.arrays import Array, Vector
from estimator.diagnosis.angle.angle_rounding import less_angle
from estimator.diagnosis.intake.drive_data import Remarked
from estimator.diagnosis.likelihood.whitening import whiten, whitening_of
from estimator.machine import Machine
from estimator.physics.rows import Rows, rows_of
from estimator.samples import Samples, turned_angle

_MATTERS: Final = 1e-4  # rad, rms, by which the two frames are apart
_ORDERS: Final = range(1, 5)
_WHOLE: Final = 0.25  # by which a share may be off one
_SURELY: Final = 8.0  # standard errors, and
_SHARPEST: Final = 0.1  # its standard error at most
_STRETCHES: Final = 16
_TURNS: Final = 4  # of the fit
_MACHINE: Final = 4  # its parameters
_TOLD: Final = 1e-10  # of the columns' energy, that is more than their last digits
_REMARK: Final = (
    "u_d and u_q are taken as turned on over half a period by omega_e, which is smoother than theta_e: it leaves less "
    "than the middle of two angles"
)


def in_own_frame(runs: Sequence[Samples], nominal: Machine) -> Remarked:
    """The runs with voltages in the frame of the middle of each period's two angles, whatever turned them."""
    by = [_ahead(run) for run in runs]
    every = np.concatenate(by)
    if any(run.periods != 1 or run.q_only for run in runs) or float(np.sqrt(np.mean(every**2))) < _MATTERS:
        return Remarked(tuple(runs), ())
    share, std = _share(rows_of(runs, nominal, nominal.i_rated or 1.0), _of_rows(by))
    if abs(share - 1.0) > _WHOLE or std > min(share / _SURELY, _SHARPEST):
        return Remarked(tuple(runs), ())
    return Remarked(tuple(_turned(run, x) for run, x in zip(runs, by, strict=True)), (_REMARK,))


def _ahead(run: Samples) -> Array:
    """By how much the frame that speed foretells is ahead of the middle of two angles (rad, of each row)."""
    turned = turned_angle(run.theta_e, run.omega_e, run.T_s)
    ahead = 0.5 * (run.T_s * run.omega_e[:-1] - turned)
    return np.concatenate((ahead, np.zeros(1)))


def _of_rows(by: Sequence[Array]) -> Array:
    """Of all runs' periods, those between runs too."""
    return np.concatenate(by)[:-1]


def _turned(run: Samples, by: Array) -> Samples:
    u: Vector = (run.u_d + 1j * run.u_q) * np.exp(1j * by)
    return replace(run, u_d=u.real.copy(), u_q=u.imag.copy())


def _share(rows: Rows, ahead: Array) -> tuple[float, float]:
    """Of -j x u in what the machine leaves, and its standard error as stretches scatter.

    An error of the angle turns what it is seen by, so the rows are rid of it as it is found.
    """
    off, waves = np.zeros(len(rows.theta_e)), _waves(rows)
    share = std = 0.0
    for _ in range(_TURNS):
        true = less_angle(rows, off)
        found, error = _fitted(true, ahead, waves)
        off, share, std = off + found[_MACHINE + 1 :] @ waves, float(found[0]), error
    return share, std


def _waves(rows: Rows) -> Array:
    """Of the measured angle, at samples: what its error may go by."""
    powers = [rows.rotor**order for order in _ORDERS]
    return np.stack([np.ones(len(rows.theta_e)), *(part for x in powers for part in (x.real, x.imag))])


def _fitted(rows: Rows, ahead: Array, waves: Array) -> tuple[Array, float]:
    """Coefficients of -j x u, of changes of the machine and of an angle's waves; the first one's standard error."""
    m, i = rows.machine, rows.i
    left = rows.u - m.R_s * rows.i_mean - rows.balance(rows.flux(i))
    by_angle = rows.flux(1j * i) - m.psi_f - 1j * rows.flux(i)  # of an angle that is further, Vs/rad
    v = np.stack((
        -1j * ahead * rows.u, rows.i_mean, rows.balance(i.real), rows.balance((1j * i.imag).astype(np.complex128)),
        rows.balance(np.ones(len(i))), *(rows.balance((by_angle * wave).astype(np.complex128)) for wave in waves), left,
    ))  # fmt: skip
    rho = min(max(math.exp(-m.R_s * rows.T_s / (0.5 * (m.L_d + m.L_q))), 0.5), 0.99)
    alike = whitening_of(rows.half, rows.joined, (m.L_d, m.L_q), (rho, rho), rows.T_s)
    whiten(v, *alike, np.zeros(len(v), np.complex128))
    x: Array = np.concatenate((v.real, v.imag), axis=1)
    size = np.sqrt(np.mean(x * x, axis=1))
    x /= np.where(size > 0.0, size, 1.0)[:, None]
    A, y = x[:-1], x[-1]
    inverse: Array = np.array(np.linalg.pinv(A @ A.T, _TOLD, hermitian=True), np.float64)
    found = inverse @ (A @ y)
    score = A * (y - found @ A)
    places = np.arange(len(ahead)) * _STRETCHES // len(ahead)
    scores = np.stack([score[:, np.tile(places == k, 2)].sum(axis=1) for k in range(_STRETCHES)], axis=1)
    std = math.sqrt(max(float((inverse @ scores @ scores.T @ inverse)[0, 0]), 0.0))
    scale = size[-1] / np.where(size[:-1] > 0.0, size[:-1], math.inf)
    return found * scale, std * float(scale[0])
