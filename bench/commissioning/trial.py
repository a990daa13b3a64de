"""Trials: steps of current and of speed on a drive, recorded by its own recorder, before parameters change and after.

Currents step by the drive's own excitation between two levels (PRBS) on one axis while the other stays; the speed by a
square wave of its reference; all around a level of i_d, so that in no leg the current stays near zero, where what dead
time takes is not a voltage alike. All within limits; the drive is stopped at the end.
"""

import math
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bench.actions.safety.under_control import Guard
from bench.errors import LimitError
from drivers import capture
from drivers.capture import DONE, Capture, Setup, Upload
from drivers.drive import Drive
from drivers.errors import GoneError, NoReplyError
from drivers.lease import Lease
from drivers.wire.dictionary import CAPTURE_SAMPLES

Column = NDArray[np.float64]
Tell = Callable[[str], None]
INVERTER: Final = "inverter_correction"
"""Off while a motor is excited: what is left of a bridge's error beside its correction has no name in the library."""
_SPEED_GAINS: Final = ("k_p_speed", "k_i_speed")
SETTINGS: Final = (
    "excitation_kind", "step_time", "speed_control", "field_weakening", "speed_ramp", "speed_hold", *_SPEED_GAINS,
    INVERTER, "current_limit",
)
"""What a trial changes besides set points."""
EXCITED: Final = ("theta_e", "omega_e", "i_d", "i_q", "u_d", "u_q", "u_dc")
"""What is recorded of an excited motor."""
_LEVELS: Final = 1.0
_PRBS: Final = 2.0
_SOFT: Final = 0.02  # of the speed control's gains, while i_q steps: else it would work against the steps
_REFERENCE: Final = 1.0
_HOLDS: Final = 48  # steps of a current's trial
_SWINGS: Final = 24  # of a speed's
_SAMPLES: Final = 16_000  # of a speed's trial
_SETTLE: Final = 0.5  # s, while the speed control is not known
_MEAN: Final = 12  # readings of the speed: a coarse encoder tells it in steps
_POLL: Final = 0.02  # s
_PATIENCE: Final = 20.0  # s for a speed
_STALLED: Final = 4.0  # s for a shaft that does not move under current
_MOVES: Final = 0.2  # of how near a speed has to come, from which on it does
_STANDSTILL: Final = 10.0  # s without another sample


class StalledError(NoReplyError):
    """The shaft does not do as it is told."""


@dataclass(frozen=True, slots=True)
class CurrentTrial:
    """Steps by 2 `size` (A) on one axis at a speed (rad/s, electrical), every `hold` (s), around a level of i_d."""

    axis: str  # "d" or "q"
    size: float
    hold: float
    speed_ref: float
    i_d_ref: float = 0.0  # A


@dataclass(frozen=True, slots=True)
class SpeedTrial:
    """Steps by 2 `size` (rad/s, electrical) around `speed_ref`, every `hold` (s)."""

    size: float
    hold: float
    speed_ref: float
    rise: float = 0.0  # s, that the reference takes for a step; 0: at once
    i_d_ref: float = 0.0  # A


@dataclass(frozen=True, slots=True)
class Excitation:
    """Speed ramps between +-`speed` (rad/s, electrical) with random steps of both currents around their references."""

    speed: float
    ramp: float  # rad/s2
    hold: float  # s, at either end
    i_d_ref: float  # A
    i_d_step: float
    i_q_step: float
    step_time: float  # s
    seconds: float


@dataclass(frozen=True, slots=True)
class Reading:
    """What the encoder read while something was recorded."""

    begin: int  # tick before it was asked
    end: int  # and after
    angle: float  # rad, mechanical, uncorrected


class Trials:
    """Trials of a drive under control."""

    def __init__(self, drive: Drive, lease: Lease, guard: Guard, tell: Tell = lambda _: None) -> None:
        self._drive, self._lease, self._guard, self._tell = drive, lease, guard, tell
        self._T_s = drive.identity.T_s
        self.settle = _SETTLE
        """s that a speed control is given once the speed is there: its integral has to be as well."""
        self._tells_encoder = any(signal.name == "encoder_angle" for signal in drive.identity.signals)

    def current(self, trial: CurrentTrial) -> tuple[Column, int]:
        """Current of the axis (A), every control period, and control periods between steps."""
        hold = max(1, math.ceil(trial.hold / self._T_s - 1e-6))
        gains = {name: self._drive.read(name) for name in _SPEED_GAINS}
        self._start({
            "speed_ref": trial.speed_ref, "speed_step": 0.0, "step_time": hold * self._T_s, "i_d_ref": trial.i_d_ref
        })  # fmt: skip
        soft = {name: _SOFT * gain for name, gain in gains.items()} if trial.axis == "q" else {}
        self._lease.write(self._drive, {"excitation_kind": _PRBS, f"i_{trial.axis}_step": trial.size, **soft})
        length = min(_HOLDS * hold, CAPTURE_SAMPLES)
        phase = f"stepping i_{trial.axis} by {2.0 * trial.size:.3g} A"
        got = self._recorded(Setup((f"i_{trial.axis}",), length), phase)
        self._lease.write(self._drive, gains)
        return self._decoded(got).columns[f"i_{trial.axis}"], hold

    def speed(self, trial: SpeedTrial) -> tuple[Capture, int]:
        """theta_e, i_d, i_q and u_dc meanwhile, and samples between steps."""
        seconds = _SWINGS * trial.hold
        decimation = max(1, math.ceil(seconds / self._T_s / _SAMPLES))
        hold = max(1, round(trial.hold / (decimation * self._T_s)))
        between, rising = hold * decimation, rise_periods(trial.rise, self._T_s)
        ramp = 2.0 * trial.size / ((rising - 0.5) * self._T_s) if rising > 1 else 0.0  # the last period takes the rest
        self._start({
            "speed_ref": trial.speed_ref, "speed_step": 0.0, "speed_hold": (between - (rising - 1)) * self._T_s,
            "i_d_ref": trial.i_d_ref,
        })  # fmt: skip
        self._lease.write(self._drive, {"speed_ramp": ramp, "speed_step": trial.size})
        setup = Setup(("theta_e", "omega_e", "i_d", "i_q"), _SWINGS * hold, decimation)
        got = self._recorded(setup, f"stepping the speed by {2.0 * trial.size:.3g} rad/s")
        return self._decoded(got), hold

    def excited(self, given: Excitation) -> tuple[Upload, list[Reading]]:
        """All that a diagnosis reads, every control period; and what the encoder itself reads now and then."""
        self._start({"speed_ref": 0.0, "speed_step": 0.0, "speed_hold": given.hold, "step_time": given.step_time})
        self._lease.write(self._drive, {
            "speed_ramp": given.ramp, "speed_step": given.speed, "excitation_kind": _LEVELS, "i_d_ref": given.i_d_ref,
            "i_d_step": given.i_d_step, "i_q_step": given.i_q_step, INVERTER: 0.0,
        })  # fmt: skip
        length = min(math.ceil(given.seconds / self._T_s), CAPTURE_SAMPLES)
        readings = list[Reading]()

        def read() -> None:
            if self._tells_encoder:
                begin, angle = int(self._drive.read("tick")), self._drive.read("encoder_angle")
                readings.append(Reading(begin, int(self._drive.read("tick")), angle))

        phase = f"exciting the motor for {length * self._T_s:.2g} s"
        return self._recorded(Setup(EXCITED, length), phase, read), readings

    def _start(self, values: Mapping[str, float]) -> None:
        self._guard.check_cancelled()
        still = {"excitation_kind": 0.0, "i_d_ref": 0.0, "i_q_ref": 0.0, "i_d_step": 0.0, "i_q_step": 0.0}
        self._lease.start(self._drive, {
            **still, "field_weakening": 0.0, "speed_control": _REFERENCE, **values
        })  # fmt: skip
        self._await_speed(values["speed_ref"])

    def _decoded(self, got: Upload) -> Capture:
        return capture.decoded(got, self._T_s, self._drive.identity.full)

    def _await_speed(self, wanted: float) -> None:
        self._tell(f"bringing the shaft to {wanted:.4g} rad/s, electrical")
        near, begun = 0.05 * abs(wanted) + 0.005 * self._drive.identity.omega_full, time.monotonic()
        there = math.inf  # s, monotonic: since when it has been near
        latest = deque[float](maxlen=_MEAN)
        while time.monotonic() < there + self.settle:
            latest.append(self._drive.read("omega_e"))
            now = sum(latest) / len(latest)
            there = min(there, time.monotonic()) if abs(now - wanted) <= near else math.inf
            patience = _STALLED if abs(now) < _MOVES * near else _PATIENCE
            if time.monotonic() > begun + patience and there == math.inf:
                raise StalledError(
                    f"the drive did not come to {wanted:.4g} rad/s within {patience:g} s, it has {now:.4g} rad/s"
                )
            self._guard.check()
            self._guard.pause(_POLL)

    def _recorded(self, setup: Setup, phase: str, meanwhile: Callable[[], object] = lambda: None) -> Upload:
        drive, guard = self._drive, self._guard
        self._tell(phase)
        number = capture.arm(drive, setup)
        count, grown = -1, time.monotonic()
        while (seen := capture.seen(drive, number)).state != DONE:
            guard.check()
            meanwhile()
            if seen.count != count:
                count, grown = seen.count, time.monotonic()
            elif time.monotonic() - grown > _STANDSTILL:
                raise NoReplyError(f"the recording stands still at {count} samples for {_STANDSTILL:g} s")
            guard.pause(_POLL)
        found = capture.found(drive, setup)
        if found.number != number or found.count < setup.length:
            raise GoneError("another client has armed or stopped the recorder before the recording was complete")

        def uploaded(done: int) -> None:
            self._lease.keep(drive)
            guard.check_cancelled()
            self._tell(f"{phase}: uploading {done} of {found.count} samples")

        self._lease.stop(drive)
        capture.upload(drive, found, uploaded)
        return found


def rise_periods(rise: float, T_s: float) -> int:
    """Control periods in which the reference of the speed goes from one end to the other in `rise` (s)."""
    return max(1, round(rise / T_s))


def turned(theta_e: Column, T: float) -> Column:
    """Electrical speed (rad/s), means from sample to sample of T (s); one fewer."""
    return np.asarray((np.diff(theta_e) + math.pi) % math.tau - math.pi) / T


def largest_current_step(K: float, hold: float, speed: float) -> float:
    """A, that i_q steps up and down by, and the speed wanders by about `speed` (rad/s); K: acceleration by i_q."""
    return speed / max(2.0 * math.sqrt(_HOLDS) * abs(K) * hold, 1e-9)


def largest_speed_step(k_p_speed: float, i_max: float) -> float:
    """rad/s, electrical, that a step goes up and down by, so that currents stay within seven tenths of `i_max` (A)."""
    if k_p_speed <= 0.0:
        raise LimitError("expected a speed control with a gain above zero, k_p_speed is 0")
    return 0.35 * i_max / k_p_speed
