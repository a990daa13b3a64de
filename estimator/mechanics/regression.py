"""One length of stretches to numbers: least squares of the torque, with standard errors.

    tau_e = J alpha + B omega + T_C sign + tau_L + residual

**Which side.** The torque is what is explained: torque that acts on the shaft beside the motor's, ripple and cogging,
is then in the residual, and a speed control that works against it biases nothing. Noise in alpha does: it reads J low
by its share of alpha's energy. That share is known from the angle's fourth differences and taken off the normal matrix
(bias-eliminating least squares; T. Soederstroem, "Errors-in-variables methods in system identification", Automatica 43,
2007), and a part of the correction goes into the standard error. Were all of the residual in alpha, J would be read low
by the residual's share of the torque (R. Frisch, "Statistical confluence analysis", 1934): a part of that goes in, too.

**Residuals of any colour.** Neighbouring stretches overlap, and ripple lasts: the scores' spectrum at frequency zero is
the mean of their lowest K cosine transforms, and Student's distribution of K degrees of freedom widens the interval
(E. Lazarus, D. Lewis, J. Stock, M. Watson, "HAR inference: recommendations for practice", Journal of Business and
Economic Statistics 36(4), 2018, doi 10.1080/07350015.2018.1506926).

**What does not average away.** A converter's steps and the equation's own error come again with each swing of the
speed. Their size is no larger than the residual's, their shape may be any: a part of the residual counts as of the
shape that would hurt a parameter most. An encoder that cuts off is half a count behind, all the time.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from estimator.arrays import Array
from estimator.interval import Z_95
from estimator.machine import Machine
from estimator.mechanics.stretches import Rows, Stretches, gain_of_noise, stretches_of
from estimator.mechanics.suspects import Suspect, columns_of

J, B, T_C, TAU_L = range(4)
FEWEST: Final = 40  # stretches
_SHARE: Final = 0.2  # of the noise's correction, that goes into the standard error
_ALIGNED: Final = 0.08  # of the residual, that may be of the worst shape
_HALF: Final = 0.5 / Z_95  # of the way to the other regression: 1.96 standard errors reach half of it
_COUNT: Final = 0.27  # standard error of the angle in counts: it is off by at most half a one, which that covers
_ALIKE: Final = 1e-9  # energy of a combination of columns over theirs, below which they are one
_OWN: Final = 1e-4  # share of the torque that second-order terms of the turn in a control period leave out
_SAMPLED: Final = 0.002  # of the torque, rms, over the speed's: with dead time, currents are sampled off their means
_SLOW: Final = 0.05  # of the highest speed, below which friction is no sign
_BOTH: Final = 0.05  # share of the stretches, from which on the shaft turns in both directions


@dataclass(frozen=True, slots=True, eq=False)
class Torque:
    """What makes torque of currents, and how well that is known: 3/2 n_p (psi_f i_q + saliency i_d i_q)."""

    n_p: int
    psi_f: float  # Vs
    saliency: float  # H, L_d - L_q
    psi_f_std: float = 0.0  # standard errors
    saliency_std: float = 0.0

    @classmethod
    def of(cls, machine: Machine, std: Mapping[str, float]) -> "Torque":
        """A machine's, with standard errors by parameter; none are taken for zero."""
        saliency_std = math.hypot(std.get("L_d", 0.0), std.get("L_q", 0.0))
        return cls(machine.n_p, machine.psi_f, machine.L_d - machine.L_q, std.get("psi_f", 0.0), saliency_std)


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """What stretches of one length say. Parameters: J, B, T_C, tau_L; in one direction of speed none for T_C."""

    M: int  # rows: a stretch has four times as many
    stretches: Stretches
    columns: Array  # (4 or 3, n) of the parameters told
    every: Array  # (4 or 3 + k, n), and those of suspects
    tau: Array  # Nm
    places: tuple[int, ...]  # of the parameters told, J first
    beta: Array  # SI
    std: Array  # standard errors, all in
    residual: Array  # Nm
    noise: float  # share of the acceleration's own energy, beside the other columns
    moved: float  # rad/s2 rms, acceleration that the other columns do not tell
    explained: float  # share of the torque beside the other columns that acceleration explains
    direction: int  # of the speed, +1 or -1; 0: both

    @property
    def relative(self) -> float:
        """Standard error of J over J; infinite where that is not above zero."""
        return float(self.std[J] / self.beta[J]) if self.beta[J] > 0.0 else math.inf


def fit_of(
    runs: Sequence[Rows], M: int, torque: Torque, noise: float, step: float, fastest: float,
    beside: Sequence[Suspect] = (),
) -> Fit | None:
    """What stretches of 4 M rows say, with suspects beside the parameters; None where they are too few.

    `noise`: variance of the angle, rad^2 mechanical; `step`: of the encoder, rad electrical, 0: not known; `fastest`:
    speed, rad/s.
    """
    all_ = stretches_of(runs, M)
    if all_ is None:
        return None
    s = all_.where(all_.slowest > _SLOW * fastest)
    if len(s) < FEWEST:
        return None
    forwards = float(np.mean(s.sign > 0.0))
    both = _BOTH < forwards < 1.0 - _BOTH
    if not both:
        s = s.where((s.sign > 0.0) == (forwards > 0.5))
    direction = 0 if both else 1 if forwards > 0.5 else -1
    places = (J, B, T_C, TAU_L) if both else (J, B, TAU_L)
    columns = np.stack((s.alpha, s.omega, s.sign, np.ones(len(s))))[list(places)]
    every = np.vstack((columns, *(columns_of(suspect, s) for suspect in beside)))
    return _fitted(s, every, places, direction, M, torque, noise * gain_of_noise(M, runs[0].T), step)


def _fitted(
    s: Stretches, columns: Array, places: tuple[int, ...], direction: int, M: int, torque: Torque, noise: float,
    step: float,
) -> Fit:
    n = len(s)
    k = 1.5 * torque.n_p
    by_flux, by_saliency = k * s.i_q, k * s.i_d_i_q
    tau = torque.psi_f * by_flux + torque.saliency * by_saliency
    by_angle = k * (torque.psi_f * s.i_d + torque.saliency * s.i_d2_i_q2)
    p, scale = len(places), np.sqrt(np.mean(columns**2, axis=1))
    X = columns / np.where(scale > 0.0, scale, 1.0)[:, None]
    own = float(np.sum(without(X[0], X[1:]) ** 2))
    off = n * noise / scale[0] ** 2 if scale[0] > 0.0 else math.inf
    A = X @ X.T
    A[0, 0] -= min(off, 0.5 * own)
    inverse = np.linalg.pinv(A, hermitian=True)
    beta = inverse @ (X @ tau)
    residual = tau - beta @ X
    variance = np.diag(inverse @ _spectrum(X * residual) @ inverse)
    worst = n * np.diag(inverse)
    variance = variance + (_ALIGNED**2 * np.mean(residual**2) + _OWN**2 * np.mean(tau**2)) * worst
    for size, of in (
        (torque.psi_f_std, by_flux), (torque.saliency_std, by_saliency), (_COUNT * step, by_angle),
    ):
        variance = variance + (size * (inverse @ (X @ of))) ** 2
    rest = float(np.sum(without(tau, X[1:]) ** 2))
    explained = 1.0 - float(np.sum(residual**2)) / rest if rest > 0.0 else 0.0
    share = off / own if own > 0.0 else math.inf
    variance[0] += (_SHARE * share * beta[0]) ** 2 + (_HALF * (1.0 - explained) * beta[0]) ** 2
    if p > B and places[B] == B:
        variance[B] += _SAMPLED**2 * np.mean(tau**2)
    alike = float(np.linalg.eigvalsh(X[:p] @ X[:p].T)[0]) < _ALIKE * n  # all columns' parameters are one
    std = np.full(p, math.inf) if alike else np.sqrt(np.maximum(variance[:p], 0.0)) / scale[:p]
    return Fit(
        M, s, columns[:p], columns, tau, places, np.where(alike, 0.0, beta[:p] / np.where(scale > 0.0, scale, 1.0)[:p]),
        std, residual, share, math.sqrt(own / n) * float(scale[0]), explained, direction,
    )


def without(y: Array, X: Array) -> Array:
    """What the rows of X do not tell of y, by least squares."""
    scale = np.sqrt(np.mean(X**2, axis=1))
    Z = X / np.where(scale > 0.0, scale, 1.0)[:, None]
    return y - (np.linalg.pinv(Z @ Z.T, rcond=1e-12, hermitian=True) @ (Z @ y)) @ Z


def _spectrum(scores: Array) -> Array:
    """Covariance of the scores' sum, widened as Student's distribution does. Scores: (p, n)."""
    from scipy.special import stdtrit

    n = scores.shape[1]
    K = max(6, int(0.4 * n ** (2.0 / 3.0)))
    k = np.arange(1, K + 1)
    z = (np.fft.rfft(scores, 2 * n)[:, 1 : K + 1] * np.exp(-0.5j * math.pi / n * k)).real * math.sqrt(2.0 / n)
    return float(stdtrit(K, 0.975) / Z_95) ** 2 * n / K * (z @ z.T)
