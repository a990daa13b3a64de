"""Rows: what every effect's equation is made of - currents, angle and voltage of a run, period by period.

n control periods lie between n + 1 samples. Quantities at samples have n + 1 values, those of periods n. Complex
vectors are amplitude-invariant and in the rotor frame; those of a period in the frame of its middle.
Knows no effect.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from estimator.flux_balance import TURN
from estimator.machine import Machine
from estimator.samples import Samples

Real = NDArray[np.float64]
Vector = NDArray[np.complex128]

AXES: Final = tuple(complex(math.cos(k * TURN / 3.0), math.sin(k * TURN / 3.0)) for k in range(3))
"""Directions of the phases a, b, c."""


@dataclass(frozen=True, slots=True, eq=False)
class Stiffness:
    """d(i)/d(psi) at samples, 1/H: of a flux linkage v, a v + b conj(v)."""

    a: Real
    b: Real | Vector

    def __call__(self, v: Vector) -> Vector:
        """Current (A) that belongs to a small flux linkage (Vs)."""
        return self.a * v + self.b * v.conj()

    def __getitem__(self, samples: slice) -> "Stiffness":
        """At some samples."""
        return Stiffness(self.a[samples], self.b[samples])


@dataclass(slots=True, eq=False)
class Rows:
    """A run without gaps, or a stretch of it."""

    machine: Machine  # the best that is known now
    T_s: float  # s
    i_rated: float  # A, peak
    t: Real  # s, at samples
    i: Vector  # A, at samples
    theta_e: Real  # rad, at samples, unwrapped
    half: Vector  # exp(j D/2) of each period, D the angle turned in it
    u: Vector  # V, of each period
    joined: NDArray[np.bool_]  # of each period: its two samples are of one run
    u_dc: Real | None  # V, of each period
    zero: Real | None  # A, mean of the three measured phase currents at samples, where they are known
    span: tuple[float, float]  # s, start and length of the recording
    angle_error: float = 0.0  # rad, rms, that the angle's rounding leaves at samples
    kept: dict[str, Any] = field(default_factory=dict[str, Any])  # worked out once, at samples or of periods

    def __len__(self) -> int:
        """Control periods."""
        return len(self.u)

    def __getitem__(self, periods: slice) -> "Rows":
        """A stretch of consecutive periods (views)."""
        a, b, _ = periods.indices(len(self))
        n = len(self)

        def cut(whole: Any) -> Any:
            return whole[a : b + (len(whole) - n)]

        return replace(
            self, t=cut(self.t), i=cut(self.i), theta_e=cut(self.theta_e), half=cut(self.half), u=cut(self.u),
            joined=cut(self.joined), u_dc=None if self.u_dc is None else cut(self.u_dc),
            zero=None if self.zero is None else cut(self.zero),
            kept={key: cut(whole) for key, whole in self.kept.items()},
        )  # fmt: skip

    def once(self, key: str, make: Callable[[], Any]) -> Any:
        """An array worked out at its first use; stretches taken later have their part of it."""
        if key not in self.kept:
            self.kept[key] = make()
        return self.kept[key]

    # --- angles

    @property
    def D(self) -> Real:
        """Angle turned in each period, rad."""
        return self.once("D", lambda: np.diff(self.theta_e))

    @property
    def omega_e(self) -> Real:
        """Electrical speed in each period, rad/s."""
        return self.D / self.T_s

    @property
    def rotor(self) -> Vector:
        """exp(j theta_e) at samples."""
        return self.once("rotor", lambda: np.exp(1j * self.theta_e))

    @property
    def middle(self) -> Vector:
        """exp(j theta_e) in the middle of each period."""
        return self.rotor[:-1] * self.half

    @property
    def theta_m(self) -> Real:
        """Mechanical angle at samples, rad, but for a constant."""
        return self.theta_e / self.machine.n_p

    # --- currents

    @property
    def i_s(self) -> Vector:
        """Current at samples in the stationary frame, A."""
        return self.once("i_s", lambda: self.i * self.rotor)

    def phase(self, k: int) -> Real:
        """Current of phase k at samples, A."""
        return (self.i_s * AXES[k].conjugate()).real

    @property
    def i_mean(self) -> Vector:
        """Mean current of each period, A, in the machine without effects."""
        return self.once("i_mean", self._plain_mean_current)

    def _plain_mean_current(self) -> Vector:
        g = self.stiffness
        return self.mean_current(self.slopes(self.flux(self.i), g), g, self.machine.R_s)

    def slopes(self, psi: Vector, g: Stiffness) -> tuple[Vector, Vector]:
        """di/dt (A/s) at the begin and the end of each period, by u - R_s i - j omega psi."""

        def slope(i: Vector, psi: Vector, u_there: Vector, g: Stiffness) -> Vector:
            return g(u_there - self.machine.R_s * i - 1j * self.omega_e * psi) + 1j * self.omega_e * i

        e, u = self.half, self.u
        return slope(self.i[:-1], psi[:-1], u * e, g[:-1]), slope(self.i[1:], psi[1:], u * e.conj(), g[1:])

    def mean_current(self, slopes: tuple[Vector, Vector], g: Stiffness, R: float) -> Vector:
        """Mean current (A) of each period: the cubic through both ends and their slopes, and what pulses add.

        Pulses: the flux linkage's ripple has no mean, but a first moment M = mean of (t - middle) times ripple,
        T^2/24 u_dc d (1 - d^2) per phase. The ripple drives R into a decay, which lets the mean rise by g R g M; and
        a rotor with L_d other than L_q turns in it, which adds 2 j omega g_b conj(M).
        """
        e, (s_0, s_1) = self.half, slopes
        mean = 0.5 * (e * self.i[1:] + e.conj() * self.i[:-1]) + self.T_s / 12.0 * (e.conj() * s_0 - e * s_1)
        if self.u_dc is None:
            return mean
        M, g = self.moment_of_pulses, g[:-1]
        return mean + R * g(g(M)) + 2j * self.omega_e * g.b * M.conj()

    @property
    def moment_of_pulses(self) -> Vector:
        """First moment (Vs s) of the flux linkage's ripple in each period. Needs `u_dc`."""
        return self.once("moment of pulses", self._moment_of_pulses)

    def _moment_of_pulses(self) -> Vector:
        shape = self.duties * (1.0 - self.duties * self.duties)
        ripple = sum(2.0 / 3.0 * axis * shape[:, k] for k, axis in enumerate(AXES))
        return self.stationary(ripple * self.u_dc) * (self.T_s**2 / 24.0)  # pyright: ignore

    @property
    def power_of_pulses(self) -> tuple[Real, Vector]:
        """Means of abs(ripple)^2 and ripple^2 of the flux linkage (Vs^2) in each period. Needs `u_dc`."""
        size = self.once("size of pulses", lambda: self._power_of_pulses()[0])
        return size, self.once("square of pulses", lambda: self._power_of_pulses()[1])

    def _power_of_pulses(self) -> tuple[Real, Vector]:
        size, square = np.zeros(len(self)), np.zeros(len(self), np.complex128)
        for j, one in enumerate(AXES):
            for k, other in enumerate(AXES[: j + 1]):
                both = (1.0 if j == k else 2.0) * _common_ripple(self.duties[:, j], self.duties[:, k])
                size += (one * other.conjugate()).real * both
                square += one * other * both
        assert self.u_dc is not None
        scale = (self.u_dc * self.T_s / 3.0) ** 2  # (2/3)^2 (T_s/2)^2
        return scale * size, scale * square * (self.middle.conj()) ** 2

    # --- model

    @property
    def stiffness(self) -> Stiffness:
        """Of the machine without effects, at samples."""
        m, one = self.machine, np.ones(len(self.i))
        return Stiffness(0.5 * (1.0 / m.L_d + 1.0 / m.L_q) * one, 0.5 * (1.0 / m.L_d - 1.0 / m.L_q) * one)

    def flux(self, i: Vector) -> Vector:
        """Flux linkage (Vs) of the machine at a current (A)."""
        m = self.machine
        return m.L_d * i.real + m.psi_f + 1j * m.L_q * i.imag

    # --- bridge

    @property
    def duties(self) -> Real:
        """Share of each period that the three legs are high, (n, 3), by space-vector modulation. Needs `u_dc`."""
        return self.once("duties", self._duties)

    def _duties(self) -> Real:
        u_s, u_dc = self.u * self.middle, self.u_dc
        assert u_dc is not None
        u_abc = np.stack([(u_s * axis.conjugate()).real for axis in AXES], axis=1)
        lifted = u_abc - 0.5 * (u_abc.max(axis=1) + u_abc.min(axis=1))[:, None]
        return np.clip(0.5 + lifted / u_dc[:, None], 0.0, 1.0)

    # --- balances

    def balance(self, psi: Vector | Real) -> Vector:
        """Voltage (V) of each period that changes a flux linkage (Vs, at samples) as the rotor turns."""
        return (self.half * psi[1:] - self.half.conj() * psi[:-1]) / self.T_s

    def stationary(self, v: Vector) -> Vector:
        """A vector of each period, given in the stationary frame, in the rotor frame."""
        return v * self.middle.conj()


def _common_ripple(d: Real, e: Real) -> Real:
    """Mean product of the ripples of two legs' pulses of duties d and e, for a link of 1 V and half a period of 1 s."""
    d, e = np.minimum(d, e), np.maximum(d, e)
    inner = (1.0 - d) * d**3 / 3.0 + d * ((e * e - d * d) / 2.0 - (e**3 - d**3) / 3.0)
    return (1.0 - e) * (inner + d * e * (1.0 - e) ** 2 / 3.0)


def by_phase(alpha: float, beta: float) -> tuple[float, float, float]:
    """What a vector is on the three phases."""
    a, b, c = ((complex(alpha, beta) * axis.conjugate()).real for axis in AXES)
    return a, b, c


def rows_of(runs: Sequence[Samples], machine: Machine, i_rated: float) -> Rows:
    """The rows of a recording's runs, one after the other, one control period each. Raises ValueError.

    The periods between one run's last sample and the next one's first are not `joined`.
    """
    if any(run.periods != 1 for run in runs):
        raise ValueError("expected a row for every control period, came rows of several")
    T = runs[0].T_s

    def column(name: str) -> Real | None:
        parts = [getattr(run, name) for run in runs]
        return None if any(part is None for part in parts) else np.concatenate(parts)

    theta, omega, i_d, i_q, u_d, u_q = (
        np.concatenate([getattr(run, name) for run in runs])
        for name in ("theta_e", "omega_e", "i_d", "i_q", "u_d", "u_q")
    )
    by_speed = T * 0.5 * (omega[:-1] + omega[1:])
    off = np.diff(theta) - by_speed
    D = by_speed + off - TURN * np.floor(off / TURN + 0.5)
    n = len(D)
    joined = np.ones(n, np.bool_)
    joined[np.cumsum([len(run) for run in runs])[:-1] - 1] = False
    t: Any = np.concatenate([run.t0 + T * np.arange(len(run)) for run in runs])
    u_dc, i_a, i_b, i_c = column("u_dc"), column("i_a"), column("i_b"), column("i_c")
    u = (u_d + 1j * u_q)[:n]
    if u_dc is not None:  # duties are those of a link read at the start; it moves on within the period
        u = u * np.where(joined, 0.5 * (1.0 + u_dc[1:] / u_dc[:-1]), 1.0)
    zero = None if i_a is None or i_b is None or i_c is None else (i_a + i_b + i_c) / 3.0
    return Rows(
        machine, T, i_rated, t, i_d + 1j * i_q, theta[0] + np.concatenate(([0.0], np.cumsum(D))),
        np.exp(0.5j * D), u, joined, None if u_dc is None else u_dc[:n], zero,
        (float(t[0]), float(t[-1] - t[0])),
    )  # fmt: skip
