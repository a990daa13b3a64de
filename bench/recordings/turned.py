"""Turned: whether the angle and the speed of a recording tell the same; the estimates rest on the angle.

A speed in another unit, with the wrong sign, or behind the angle, is the only one to be wrong. A speed that is the
angle's rate times another number throughout is a second witness of time: the control period may be wrong by that
number, and L_d, L_q and psi_f with it, while the equations fit as well. A speed that does not follow the angle is no
witness, and neither is one that was set. Knows nothing of files and methods.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from estimator.diagnosis.intake.causes import speed_as
from estimator.diagnosis.intake.speed_lag import SpeedLags
from estimator.samples import Samples, turned_angle

_BLOCK: Final = 64  # rows over which both are compared
_FOLLOWS: Final = 0.01  # of the speed's mean square, that may be left where it is proportional to the angle's rate
_SHARE: Final = 0.02  # of the way, and
_TURNED: Final = 1.0  # rad, more, by which the two may differ
_SAME: Final = 0.004  # log: a speed in some unit


@dataclass(slots=True)
class Turned:
    """Takes a recording's samples in their order. `set_speed`: the speed is a constant that stands in for a column."""

    n_p: int | None  # pole pairs, where they are known
    nominal: Mapping[str, float]  # SI, those that are known
    set_speed: bool = False
    _T_s: float = 0.0  # s, control period
    _time: float = 0.0  # s
    _by_angle: float = 0.0  # rad
    _by_speed: float = 0.0  # rad
    _path: float = 0.0  # rad, without sign
    _angle2: float = 0.0  # rad^2, summed over blocks; so the others
    _speed2: float = 0.0
    _both: float = 0.0
    _lags: SpeedLags = field(default_factory=SpeedLags)

    def take(self, samples: Samples) -> None:
        """Take in a run, or a part of one."""
        if len(samples) < 2:
            return
        by_speed = 0.5 * (samples.omega_e[:-1] + samples.omega_e[1:]) * samples.T
        by_angle = turned_angle(samples.theta_e, samples.omega_e, samples.T)
        self._T_s = samples.T_s
        self._time += len(by_speed) * samples.T
        self._by_speed += float(by_speed.sum())
        self._by_angle += float(by_angle.sum())
        self._path += float(np.abs(by_speed).sum())
        at = np.arange(0, len(by_speed), _BLOCK)
        speed, angle = np.add.reduceat(by_speed, at), np.add.reduceat(by_angle, at)
        self._speed2 += float(speed @ speed)
        self._angle2 += float(angle @ angle)
        self._both += float(speed @ angle)

    def compare(self, samples: Samples) -> None:
        """Take in a run, or a part of one, without the rows that no machine makes."""
        if not self.set_speed:
            self._lags.take(samples)

    def doubt(self) -> str:
        """Why no estimate is sure, a clause; empty where nothing speaks against them."""
        if not self._differ() or self.set_speed or not self._follows() or self._unit():
            return ""
        return f"omega_e is {self._ratio:.4g} times the rate of theta_e: the control period, or one of them, is wrong"

    def remarks(self) -> tuple[str, ...]:
        """What a user should know besides, a sentence each."""
        lag = self._lags.found()
        if not self._differ():
            return (said,) if lag is not None and (said := lag.sentence()) else ()
        late = (said,) if lag is not None and (said := lag.sentence(scale=False)) else ()
        said = (
            f"theta_e turns at {self._by_angle / self._time:.4g} rad/s on average, but omega_e says "
            f"{self._by_speed / self._time:.4g} rad/s"
        )
        if self.doubt():
            period = f"control periods of {self._T_s / self._ratio:.4g} s, or " if self._ratio > 0.0 else ""
            return (f"{said}: {period}another angle or speed would be right", *late)
        unit = self._unit() if self._follows() and not self.set_speed else ""
        return (f"{said}{unit and f', which seems to be {unit}'}; the estimates rest on theta_e", *late)

    @property
    def _ratio(self) -> float:
        """Speed over the angle's rate."""
        return self._both / self._angle2

    def _differ(self) -> bool:
        return abs(self._by_angle - self._by_speed) > _SHARE * self._path + _TURNED

    def _follows(self) -> bool:
        """The speed is the angle's rate times a number throughout."""
        left = self._speed2 - self._both**2 / self._angle2 if self._angle2 > 0.0 else self._speed2
        return self._both != 0.0 and left < _FOLLOWS * self._speed2

    def _unit(self) -> str:
        """The unit of a speed that is wrong alone, or its sign, in words; empty: it may be the control period.

        A whole number of pole pairs may be either, unless a nominal value that goes with time has been met.
        """
        found = speed_as(self._ratio, self.n_p or 1, _SAME)
        if found is None or found[0] == 1.0:
            return ""
        whole = abs(found[0]) != 1.0 and abs(1.0 / found[0]) == round(abs(1.0 / found[0]))
        return "" if whole and not {"L_d", "L_q", "psi_f"} & self.nominal.keys() else found[1]
