"""Samples: SI columns of one recording or stream without gaps, as every estimator takes them."""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Column = NDArray[np.float64]

_SAME_ANGLE: Final = 1e-9  # of the largest


class Resolution(NamedTuple):
    """Steps of what was measured and recorded; 0 = not known, taken for none."""

    i: float = 0.0  # A
    u: float = 0.0  # V
    theta_e: float = 0.0  # rad, of the angle as the sensor tells it, rounded or cut off, and rounded to be recorded
    encoder: float = 0.0  # rad, of that by the sensor, which the drive itself turns currents by

    @property
    def turned(self) -> float:
        """Share of the angle's rounding by which the drive turned the currents; all of it where that is not known."""
        known = self.encoder > 0.0 and self.theta_e > 0.0
        return min((self.encoder / self.theta_e) ** 2, 1.0) if known else 1.0

    @property
    def numbers(self) -> float:
        """Step (rad) of the numbers that hold the encoder's counts: a resolution is the root of both squares."""
        return math.sqrt(max(self.theta_e**2 - self.encoder**2, 0.0))


NOT_KNOWN: Final = Resolution()


class Edges(NamedTuple):
    """Of Hall sensors, six an electrical turn, that an angle goes through."""

    place: float  # rad, modulo 60 deg, where they should be
    error: float  # rad, rms, that a rotor may be off the course between them


class LeftOut(NamedTuple):
    """Rows of a recording that are known and yet not taken, from the sample before them to the one after."""

    turned: float | None  # rad electrical, by which the rotor turned meanwhile
    heat: float  # A^2 s, integral of the squared current


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Consecutive rows, columns of equal length n (float64), by the period convention.

    Row k starts at `t0 + k T`. `theta_e i_d i_q` are sampled there; `u_d u_q` is the voltage applied over
    the row, in the rotor frame at each control period's middle. A row covers `periods` control periods of
    `T_s`; where that is one, the mean currents are the mean of the row's two ends and may be left out.

    `q_only`: u_d was not recorded and is zeros that tell nothing, so that the d axis has no equation. So is i_d, unless
    it was recorded: that of a drive that controls it to zero.
    """

    theta_e: Column  # rad, wrapped or not
    omega_e: Column  # rad/s, settles how many turns a long row made
    i_d: Column  # A
    i_q: Column  # A
    u_d: Column  # V
    u_q: Column  # V
    T_s: float  # s, control period
    periods: int = 1  # control periods per row
    i_d_mean: Column | None = None  # A, mean over the row; needed where periods > 1
    i_q_mean: Column | None = None  # A
    t0: float = 0.0  # s, time of the first row
    resolution: Resolution = NOT_KNOWN
    u_dc: Column | None = None  # V, dc link
    i_a: Column | None = None  # A, phase currents as measured, where all three are
    i_b: Column | None = None
    i_c: Column | None = None
    left_out: LeftOut | None = None  # what is known of the rows between the samples before and these
    q_only: bool = False
    edges: Edges | None = None  # that the angle goes through, where it is made of such

    def __len__(self) -> int:
        return len(self.theta_e)

    @property
    def T(self) -> float:
        """Duration of a row in s."""
        return self.periods * self.T_s

    def __getitem__(self, rows: slice) -> "Samples":
        """A stretch of consecutive rows (views, step 1)."""
        start, stop, step = rows.indices(len(self))
        if step != 1:
            raise ValueError(f"samples are consecutive: expected a slice of step 1, got {step}")
        rows = slice(start, stop)

        def cut(column: Column | None) -> Column | None:
            return None if column is None else column[rows]

        return Samples(
            self.theta_e[rows], self.omega_e[rows], self.i_d[rows], self.i_q[rows], self.u_d[rows], self.u_q[rows],
            self.T_s, self.periods, cut(self.i_d_mean), cut(self.i_q_mean), self.t0 + start * self.T, self.resolution,
            cut(self.u_dc), cut(self.i_a), cut(self.i_b), cut(self.i_c), self.left_out if start == 0 else None,
            self.q_only, self.edges,
        )


def is_integral_of_speed(samples: Samples) -> bool:
    """Whether the angle is the integral of the speed column, to its last digits: there is no other."""
    off = np.diff(samples.theta_e) - 0.5 * samples.T * (samples.omega_e[1:] + samples.omega_e[:-1])
    largest = float(np.max(np.abs(samples.theta_e), initial=0.0))
    return bool(np.max(np.abs(off), initial=0.0) < _SAME_ANGLE * (1.0 + largest))


def turned_angle(theta_e: Column, omega_e: Column, T: float) -> Column:
    """Electrical angle turned from each row to the next, rad: the angle's change, in as many turns as the speed says.

    theta_e: rad, wrapped or not; omega_e: rad/s; both (n,). T: s from row to row. Returns (n - 1,).
    """
    return nearest_turns(np.diff(theta_e), T * 0.5 * (omega_e[:-1] + omega_e[1:]))


def nearest_turns(angle: Column, expected: Column) -> Column:
    """The angles, rad, of which only what is left of whole turns is known, nearest to what is expected of them."""
    off = angle - expected
    return expected + off - math.tau * np.floor(off / math.tau + 0.5)
