"""How far a drive's set points may go: the machine's rated current and largest speed, unless raised by name.

Before the wire, and for whoever asks; the drive's own limits and trips stand behind them. Knows nothing of drives.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from bench.errors import LimitError

RPM: Final = math.tau / 60.0  # rad/s
_WITHIN: Final = 1.001  # of a limit: what rounding adds
TRIP: Final = 1.1  # times the largest speed, beyond which a drive that has an overspeed trip switches off


@dataclass(frozen=True, slots=True)
class Limits:
    """Of one drive; None where a limit is not known."""

    i_max: float | None = None  # A, peak: of the current vector, with the steps
    speed_max_rpm: float | None = None  # rpm, mechanical
    raised_by: str = "the configuration's [drives.NAME.limits]"  # where the user may say otherwise, in words

    def check_current(self, i: float, what: str) -> None:
        """Raise LimitError where a current vector of this length (A) is too long."""
        if self.i_max is not None and not i <= _WITHIN * self.i_max:
            raise LimitError(
                f"{what}: currents go up to {self.i_max:g} A, the machine's rated one unless {self.raised_by} raises "
                f"it by i_max, got {i:.4g} A with the steps"
            )

    def check_speed(self, rpm: float, what: str) -> None:
        """Raise LimitError where a mechanical speed (rpm) is too high."""
        if self.speed_max_rpm is not None and not abs(rpm) <= _WITHIN * self.speed_max_rpm:
            raise LimitError(
                f"{what}: speeds go up to {self.speed_max_rpm:g} rpm, the machine's largest unless {self.raised_by} "
                f"raises it by speed_max_rpm, got {rpm:.5g} rpm"
            )

    def check_set_points(self, values: Mapping[str, float], n_p: float, what: str) -> None:
        """Raise LimitError where set points (SI), each as it will be then, are too far."""
        i_d = abs(values["i_d_ref"]) + values["i_d_step"]
        i_q = abs(values["i_q_ref"]) + values["i_q_step"]
        self.check_current(math.hypot(i_d, i_q), what)
        self.check_speed((abs(values["speed_ref"]) + values["speed_step"]) / (n_p * RPM), what)
