"""Pole pairs, phase order, direction and angle offset of a motor whose encoder is not known yet.

A current along the d axis of a forced angle phi turns the rotor's magnets towards it. At rest the encoder reads

    theta_enc = s phi / n_p + c - delta(phi) / n_p        s = 1, or -1 where it counts against the phases' order

with delta the angle by which load and friction keep the rotor back, for small ones

    delta = tau / (3/2 n_p (psi_f I - (L_q - L_d) I^2))

The field goes forth and back in steps; friction keeps the rotor back on either way and falls out of their mean, a load
does not: what two currents show, held over what keeps the rotor aligned, tells the offset without one. For that alone
the drive's data sheet is believed, which the interval allows for. The rotor stays within half a mechanical turn of
where the field first took it, which itself is at most half an electrical turn away.

From inside a drive a motor whose phases b and c are crossed cannot be told from an encoder that counts down: both make
the encoder go against the field. Which of them is put right is whose direction is to be forwards, see `Forwards`.
"""

import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bench.actions.safety.limits import Limits
from bench.actions.safety.under_control import Guard
from bench.errors import BenchError
from drivers.drive import Drive
from drivers.lease import Lease
from estimator.interval import Z_95

Column = NDArray[np.float64]
Tell = Callable[[str], None]

SHARES: Final = (0.2, 0.35, 0.6)  # of the current that is allowed: the first that the rotor follows
MOST_PAIRS: Final = 50
_FURTHEST: Final = 0.95  # turns, mechanical, from where the rotor was: beyond, it is switched off
_PAIRS_A_TURN: Final = 10  # electrical turns that the field goes: one for so many pole pairs
_SWEEP: Final = math.radians(60.0)  # to either side, at first
_STEPS: Final = 8  # places a way
_SPEED: Final = 6.0  # rad/s, of the field
_REST: Final = 0.005  # rad, mechanical: a rotor that moves by less in `_STILL` rests
_STILL: Final = 0.1  # s
_LONGEST: Final = 8.0  # s that it may take to come to rest
_WHOLE: Final = 0.12  # of a pole pair, that their number may be off a whole one; more of many
_PAIRS_KNOWN: Final = 20  # up to so many, that is enough
_LINEAR: Final = 0.25  # rad, electrical: the largest scatter of the places that a rotor which follows has
_LARGER: Final = 1.5  # times the first current, the second
_STIFFER: Final = 0.85  # of what the first one yields to a load, that the second may at most
_SHEET: Final = 0.3  # of what a load moved, that a data sheet leaves open
_LARGEST_LAG: Final = math.radians(40.0)  # that friction and load may keep the rotor back
_POLL: Final = 0.005  # s


class UnclearError(BenchError):
    """It cannot be told, and a sentence why."""


class Forwards(StrEnum):
    """Whose direction is to be forwards."""

    ENCODER = "encoder"  # it counts up: phases are swapped where the field goes against it
    PHASES = "phases"  # as they are connected: the encoder is reversed


@dataclass(frozen=True, slots=True)
class FirstStart:
    """What was found, and what the drive's signals are to be for it."""

    n_p: int
    against: bool  # the encoder counted against the field
    angle_offset: float  # rad, electrical
    offset_error: float  # rad, half of a 95 % interval, by how the places scatter
    lag: float  # rad, electrical, that friction kept the rotor back
    load: float  # rad, electrical, that a load held it aside at the larger current
    current: float  # A
    moved: float  # turns, mechanical, the furthest that the encoder was from where it began
    values: Mapping[str, float]  # n_p, phases_swapped, angle_reversed, angle_offset

    @property
    def said(self) -> str:
        """What it did and found."""
        way = "against" if self.against else "with"
        offset, error = math.degrees(self.angle_offset), math.degrees(self.offset_error)
        return (
            f"{self.n_p} pole pairs; the encoder counts {way} the field, and is {offset:.1f} deg ± {error:.1f} deg "
            f"(electrical) off; {self.current:.3g} A turned the shaft by up to {360.0 * self.moved:.0f} deg"
        )


@dataclass(frozen=True, slots=True)
class _Place:
    """Where the field stood, and the encoder."""

    phi: float  # rad, electrical
    enc: float  # rad, mechanical, unwrapped
    way: int  # 1: the field came from below


class _Motor:
    """The motor under a forced angle, step by step, under control."""

    def __init__(self, drive: Drive, lease: Lease, guard: Guard, tell: Tell) -> None:
        self._drive, self._lease, self._guard, self._tell = drive, lease, guard, tell
        self._phase = ""
        self.phi = 0.0
        self._last = drive.read("encoder_angle")
        self._origin = self.enc = self._last
        self.moved = 0.0  # turns

    def say(self, phase: str) -> None:
        """What is done from now on, which is told again and again while it is."""
        self._phase = phase
        self._tell(phase)

    def on(self) -> None:
        """The bridge on without current, the field at angle zero."""
        self._lease.start(self._drive, {
            "angle_source": 1.0, "forced_angle": 0.0, "forced_speed": _SPEED, "speed_control": 0.0,
            "i_q_ref": 0.0, "i_d_step": 0.0, "i_q_step": 0.0, "i_d_ref": 0.0,
        })  # fmt: skip
        self.phi = 0.0

    def current(self, current: float) -> None:
        """A current along the field."""
        self._lease.write(self._drive, {"i_d_ref": current})

    def to(self, phi: float) -> float:
        """Turn the field to an angle (rad), and wait for the rotor; where the encoder rests, rad, unwrapped."""
        self._lease.write(self._drive, {"forced_angle": phi})
        self._wait(abs(phi - self.phi) / _SPEED)
        self.phi = phi
        return self.rest()

    def rest(self) -> float:
        """Where the encoder comes to rest; the middle of what is left of a swing. Raises UnclearError."""
        deadline = time.monotonic() + _LONGEST
        while True:
            self._tell(self._phase)
            seen = self._wait(_STILL)
            if max(seen) - min(seen) < _REST:
                return 0.5 * (min(seen) + max(seen))
            if time.monotonic() > deadline:
                swing = 0.5 * (max(seen) - min(seen))
                raise UnclearError(f"the shaft swings by {math.degrees(swing):.2g} deg and does not come to rest")

    def _wait(self, seconds: float) -> list[float]:
        """What the encoder reads meanwhile, rad, unwrapped; at least twice."""
        seen, end = list[float](), time.monotonic() + seconds
        while len(seen) < 2 or time.monotonic() < end:
            self._look()
            seen.append(self.enc)
            self._lease.keep(self._drive)  # a field of many pole pairs has far to go
            self._guard.pause(_POLL)
        self._guard.check()
        return seen

    def _look(self) -> None:
        now = self._drive.read("encoder_angle")
        self.enc += (now - self._last + math.pi) % math.tau - math.pi
        self._last = now
        self.moved = max(self.moved, abs(self.enc - self._origin) / math.tau)
        if self.moved > _FURTHEST:
            raise UnclearError(
                f"the shaft turned by {self.moved:.2f} turns, expected less than {_FURTHEST:g}: it was switched off"
            )


SETTINGS: Final = ("speed_control", "forced_speed")
"""What it changes besides set points."""


def first_start(
    drive: Drive, lease: Lease, most: float, forwards: Forwards = Forwards.ENCODER, tell: Tell = lambda _: None,
    cancelled: threading.Event | None = None,
) -> FirstStart:  # fmt: skip
    """Find it out with at most `most` (A), by a lease that is held; the bridge is off afterwards.

    Raises UnclearError, CancelledError, DriveError.
    """
    if not any(signal.name == "forced_angle" for signal in drive.identity.signals):
        raise UnclearError(f"a drive of layout 0x{drive.identity.layout_id:08X} has no forced angle, which this needs")
    guard = Guard(drive, lease, Limits(i_max=most), "the first start", cancelled or threading.Event())
    motor = _Motor(drive, lease, guard, tell)
    try:
        current = _aligned(motor, most)
        motor.say("turning the field")
        slope = _fitted(_swept(motor, _SWEEP)).slope
        n_p = round(1.0 / abs(slope)) if slope else 0
        if not 1 <= n_p <= MOST_PAIRS:
            least = f"1/{MOST_PAIRS}"
            raise UnclearError(f"the encoder turned by {abs(slope):.3g} of the field's angle, expected {least} to 1")
        span = _span(n_p)
        if span > _SWEEP:
            motor.say(f"turning the field by {span / math.pi:.2g} turns")
        currents = _pair(drive, current)
        fits = list[_Fit]()
        for one in currents:
            motor.current(one)
            fits.append(_fitted(_swept(motor, span)))
        return _found(drive, fits, currents, forwards, motor.moved)
    finally:
        lease.stop(drive)


def _aligned(motor: _Motor, most: float) -> float:
    """The smallest current (A) that takes the rotor along, which then rests at the field."""
    motor.on()
    for share in SHARES:
        current = share * most
        motor.say(f"aligning the rotor by {current:.3g} A")
        motor.current(current)
        there = [motor.rest(), motor.to(math.pi / 3.0), motor.to(0.0), motor.to(-math.pi / 3.0), motor.to(0.0)]
        ways = np.diff(there[1:])  # from a third of half a turn on: back, back, forth
        if abs(ways[0] + ways[1]) > 0.5 * math.tau / 3.0 / MOST_PAIRS and ways[0] * ways[1] > 0.0 > ways[1] * ways[2]:
            return current
    raise UnclearError(
        f"the rotor does not follow {SHARES[-1] * most:.3g} A: expected a shaft that is free to turn, and a motor that "
        "is connected; a larger current may be allowed by i_max"
    )


def _span(n_p: int) -> float:
    """How far the field goes to either side, rad: whole electrical turns, within half a mechanical one in all."""
    return max(_SWEEP, math.pi * min(math.ceil(n_p / _PAIRS_A_TURN), n_p // 2))


def _swept(motor: _Motor, span: float) -> list[_Place]:
    """To one side, to the other and back: every place of the way between the ends is passed in both directions."""
    up = span * (np.arange(2 * _STEPS) + 0.5 - _STEPS) / _STEPS  # in the middles: what repeats over it falls out
    motor.to(-span)
    places = [_Place(phi, motor.to(phi), 1) for phi in map(float, up)]
    motor.to(span)
    places += [_Place(phi, motor.to(phi), -1) for phi in map(float, up[::-1])]
    motor.to(0.0)
    return places


@dataclass(frozen=True, slots=True)
class _Fit:
    slope: float  # of the encoder over the field
    middle: float  # rad, mechanical: the encoder at field angle zero, without friction
    lag: float  # rad, mechanical: either way
    scatter: float  # rad, mechanical, standard deviation
    error: float  # rad, mechanical, of the middle: standard deviation


def _fitted(places: Sequence[_Place]) -> _Fit:
    """enc = middle + slope phi - lag way: least squares."""
    phi = np.array([place.phi for place in places])
    way = np.array([float(place.way) for place in places])
    enc = np.array([place.enc for place in places])
    X = np.column_stack((np.ones_like(phi), phi, way))
    beta, *_ = np.linalg.lstsq(X, enc)
    scatter = float(np.sqrt(np.sum((enc - X @ beta) ** 2) / max(1, len(enc) - 3)))
    error = scatter * math.sqrt(float(np.linalg.inv(X.T @ X)[0, 0]))
    return _Fit(float(beta[1]), float(beta[0]), float(abs(beta[2])), scatter, error)


def _pair(drive: Drive, current: float) -> tuple[float, float]:
    """Two currents (A) of which the second holds the rotor better: one of them this one. Raises UnclearError."""
    for pair in ((current, _LARGER * current), (current / _LARGER, current)):
        if _yielding(drive, pair[1]) <= _STIFFER * _yielding(drive, pair[0]):
            return pair
    raise UnclearError(f"more than {current:.3g} A does not hold the rotor any better: expected a smaller current")


def _yielding(drive: Drive, current: float) -> float:
    """By how much a torque turns the rotor away from the field of a current (A), by the data sheet; of arbitrary size,
    infinite where the current does not hold it.
    """
    psi_f, L_d, L_q = (drive.read(f"control_{name}") for name in ("psi_f", "L_d", "L_q"))
    stiffness = psi_f * current - (L_q - L_d) * current**2
    return 1.0 / stiffness if stiffness > 0.0 else math.inf


def _found(
    drive: Drive, fits: Sequence[_Fit], currents: tuple[float, float], forwards: Forwards, moved: float
) -> FirstStart:
    """What two currents have shown. Raises UnclearError."""
    small, large = fits
    pairs = 1.0 / abs(large.slope)
    n_p = round(pairs)
    near = _WHOLE * max(1.0, n_p / _PAIRS_KNOWN)
    if not 1 <= n_p <= MOST_PAIRS or abs(pairs - n_p) > near or large.slope * small.slope < 0.0:
        raise UnclearError(f"the field turned {pairs:.3g} times as far as the shaft, expected a whole number of times")
    if n_p * large.scatter > _LINEAR:
        raise UnclearError(
            f"the shaft follows the field by steps of {math.degrees(n_p * large.scatter):.3g} deg (electrical), "
            "expected less: something holds it, such as cogging, a brake or a stop"
        )
    yields = [_yielding(drive, one) for one in currents]
    beyond = yields[1] / (yields[0] - yields[1])  # from the larger current on to where no load would move it
    moved_by = beyond * (large.middle - small.middle)
    middle, load = large.middle + moved_by, n_p * abs(moved_by)
    lag = n_p * small.lag
    if lag > _LARGEST_LAG or load > _LARGEST_LAG:
        raise UnclearError(
            f"friction keeps the rotor back by {math.degrees(lag):.3g} deg and a load by {math.degrees(load):.3g} deg "
            f"(electrical), expected less than {math.degrees(_LARGEST_LAG):.3g}"
        )
    noise = math.hypot((1.0 + beyond) * large.error, beyond * small.error)
    error = Z_95 * n_p * noise + _SHEET * load
    against = large.slope < 0.0
    swapped = int(drive.read("phases_swapped"))
    reverse = against and forwards is Forwards.PHASES
    if against and not reverse:
        swapped = 1 - swapped
    offset = n_p * middle if reverse else -n_p * middle
    offset = (offset + math.pi) % math.tau - math.pi
    values = {
        "n_p": float(n_p), "phases_swapped": float(swapped), "angle_reversed": float(reverse), "angle_offset": offset
    }
    return FirstStart(n_p, against, offset, error, lag, load, currents[1], moved, values)
