"""How far a drive's set points may go: the machine's rated current and largest speed, unless raised by name.

Before the wire, and for whoever asks; the drive's own limits and trips stand behind them. What its loops make of set
points is looked at while it runs.
"""

import math
import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Final

from bench.errors import LimitError
from drivers.drive import Drive
from drivers.wire.dictionary import SET_POINTS

RPM: Final = math.tau / 60.0  # rad/s
JUDGED: Final = (*SET_POINTS, "field_weakening", "i_d_weakening", "n_p")
"""What of a drive decides how far its set points go."""
_WITHIN: Final = 1.001  # of a limit: what rounding adds
TRIP: Final = "overspeed_trip"
_OVERSPEED: Final = 1.1  # times the largest speed, beyond which a drive that has such a trip switches off
_OVERLOAD: Final = (1.25, 0.3)  # times the largest current, and for so many s, that a drive's own loops may ask for


@dataclass(frozen=True, slots=True)
class Limits:
    """Of one drive; None where a limit is not known."""

    i_max: float | None = None  # A, peak: of the current vector, with the steps
    speed_max_rpm: float | None = None  # rpm, mechanical
    raised_by: str = "the configuration's [drives.NAME.limits]"  # where the user may say otherwise, in words
    n_p: int | None = None  # pole pairs of the machine; where not known, the drive's setting is believed

    def check_current(self, i: float, what: str, beside: str = " with the steps") -> None:
        """Raise LimitError where a current vector of this length (A) is too long; `beside`: what is counted in."""
        if self.i_max is not None and not i <= _WITHIN * self.i_max:
            raise LimitError(
                f"{what}: currents go up to {self.i_max:g} A, the machine's rated one unless {self.raised_by} raises "
                f"it by i_max, got {i:.4g} A{beside}"
            )

    def check_speed(self, rpm: float, what: str) -> None:
        """Raise LimitError where a mechanical speed (rpm) is too high."""
        if self.speed_max_rpm is not None and not abs(rpm) <= _WITHIN * self.speed_max_rpm:
            raise LimitError(
                f"{what}: speeds go up to {self.speed_max_rpm:g} rpm, the machine's largest unless {self.raised_by} "
                f"raises it by speed_max_rpm, got {rpm:.5g} rpm"
            )

    def check_set_points(self, values: Mapping[str, float], what: str) -> None:
        """Raise LimitError where set points and settings (`JUDGED`, SI), each as it will be then, are too far."""
        weakening = values["i_d_weakening"] if values["field_weakening"] else 0.0
        i_d = max(abs(values["i_d_ref"]), abs(values["i_d_ref"] - weakening)) + values["i_d_step"]
        i_q = abs(values["i_q_ref"]) + values["i_q_step"]
        self.check_current(math.hypot(i_d, i_q), what)
        n_p = self.n_p or values["n_p"]
        self.check_speed((abs(values["speed_ref"]) + values["speed_step"]) / (n_p * RPM), what)

    def trip(self, n_p: float) -> float | None:
        """What a drive's overspeed trip should be at most, rad/s, electrical. `n_p`: as the drive has it."""
        most = self.speed_max_rpm
        return None if most is None else _OVERSPEED * most * RPM * (self.n_p or n_p)

    def check_trip(self, trip: float, n_p: float, when: str = " while the drive is controlled") -> None:
        """Raise LimitError where a drive would get an overspeed trip (rad/s) beyond `trip`."""
        most = self.trip(n_p)
        if most is not None and trip > _WITHIN * most:
            raise LimitError(
                f"{TRIP} goes up to {most:.4g} rad/s{when}, {_OVERSPEED:g} times the machine's "
                f"largest speed unless {self.raised_by} raises it by speed_max_rpm, got {trip:g}"
            )

    def problems(self, values: Mapping[str, float], changed: Collection[str]) -> list[str]:
        """Why parameters of a drive may not be so (SI, by name): of those that are `changed`, a sentence each."""
        weakening = values["i_d_weakening"] if values["field_weakening"] else 0.0
        n_p = values["n_p"]
        checks: dict[tuple[str, ...], Callable[[], None]] = {
            ("n_p",): lambda: self._check_pole_pairs(n_p),
            ("current_limit",): lambda: self.check_current(values["current_limit"], "current_limit", ""),
            ("field_weakening", "i_d_weakening"): lambda: self.check_current(weakening, "i_d_weakening", ""),
            (TRIP, "n_p"): lambda: self.check_trip(values[TRIP], n_p, ""),
        }
        told = list[str]()
        for names, check in checks.items():
            if set(names).isdisjoint(changed):
                continue
            try:
                check()
            except LimitError as error:
                told.append(str(error))
        return told

    def _check_pole_pairs(self, n_p: float) -> None:
        if self.n_p not in (None, n_p):
            raise LimitError(
                f"n_p: the machine file says {self.n_p} pole pairs, by which speeds are bounded, got {n_p:g}"
            )


class Overload:
    """Whether a current stays beyond what the machine takes, as a drive's loops of speed and field may have it."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._since: float | None = None  # s, monotonic

    def told(self, drive: Drive) -> str:
        """That it does, a clause, and for how long; empty where it does not. To be asked often. Raises DriveError."""
        if (most := self._limits.i_max) is None:
            return ""
        i, now = math.hypot(drive.read("i_d"), drive.read("i_q")), time.monotonic()
        times, longest = _OVERLOAD
        if i <= times * most:
            self._since = None
            return ""
        self._since = now if self._since is None else self._since
        if now - self._since < longest:
            return ""
        return (
            f"{i:.3g} A for {now - self._since:.1f} s: currents go up to {most:g} A, the machine's rated one unless "
            f"{self._limits.raised_by} raises it by i_max"
        )
