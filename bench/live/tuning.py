"""The Kalman filter's tuning as a user sets it: three presets, each with settings of its own. Knows nothing of streams.

    tuned    from what a data sheet says: noise_i, lsb, omega_e, doubt, warming
    paper    the published variances
    custom   model, P_0, Q, R, i_min

Settings of a preset that is not in use are kept. See `estimator.online.ekf` for what they mean.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Final, cast

from bench.errors import LimitError, shown
from estimator.online import ekf
from estimator.online.ekf import EkfTuning, FilterModel

PRESETS: Final = ("tuned", "paper", "custom")
MODELS: Final = {"inductances": FilterModel.INDUCTANCES, "fluxes": FilterModel.FLUXES}

_RANGES: Final = {
    "noise_i": (1e-6, 1e4, "A"), "lsb": (0.0, 1e4, "A"), "omega_e": (0.0, 1e5, "rad/s"), "doubt": (0.01, 1.0, ""),
    "warming": (0.0, 1e3, "K/s"), "i_min": (1e-6, 1e4, "A"),
}
_VARIANCES: Final = {"P_0": (5, 1e-20), "Q": (5, 0.0), "R": (2, 1e-12)}  # how many, and the least, SI
_MOST: Final = 1e6  # of a variance, SI


@dataclass(frozen=True, slots=True)
class Tuning:
    """All settings of the filter; `preset` says which of them apply."""

    preset: str = "tuned"
    noise_i: float = 0.01  # A, standard deviation of a phase current's sensor
    lsb: float = 0.009  # A, resolution of a phase current's converter
    omega_e: float | None = None  # rad/s, electrical speed; None: the largest of the first rows
    doubt: float = 0.3  # relative deviation of the start values
    warming: float = 1.0  # K/s
    model: str = "fluxes"
    P_0: tuple[float, ...] = ekf.PAPER.P_0
    Q: tuple[float, ...] = ekf.PAPER.Q
    R: tuple[float, ...] = ekf.PAPER.R
    i_min: float = ekf.PAPER.i_min  # A

    @property
    def learns_speed(self) -> bool:
        """The speed is to be taken from the stream."""
        return self.preset == "tuned" and self.omega_e is None

    def changed(self, change: object) -> "Tuning":
        """This tuning with some settings replaced. Raises LimitError, in a sentence, when it cannot work."""
        known = [f.name for f in fields(self)]
        if not isinstance(change, Mapping):
            raise LimitError(f'ekf: expected settings such as {{"preset": "tuned"}}, got {shown(change)}')
        values: dict[str, Any] = {}
        for key, value in cast(Mapping[str, object], change).items():
            if key not in known:
                raise LimitError(f"ekf: expected {', '.join(known[:-1])} or {known[-1]}, got {shown(key)}")
            values[key] = _value(key, value)
        if values.get("model", self.model) != self.model and not {"P_0", "Q"} <= values.keys():
            raise LimitError(
                f"ekf: the states of model {values['model']} are others than those of {self.model}, so P_0 and Q are "
                "needed with it, got none"
            )
        return replace(self, **values)

    def for_filter(self, start: Mapping[str, float], omega_e: float, T_s: float) -> EkfTuning:
        """In the estimator's terms, for start values in SI; `omega_e` (rad/s) where the setting leaves it open."""
        if self.preset == "paper":
            return ekf.PAPER
        if self.preset == "tuned":
            return ekf.tuned(
                start["R_s"], start["L_d"], start["L_q"], noise_i=self.noise_i, lsb=self.lsb,
                omega_e=omega_e if self.omega_e is None else self.omega_e, T_s=T_s, doubt=self.doubt,
                warming=self.warming,
            )
        P_0, Q, R = cast(tuple[ekf.Five, ekf.Five, tuple[float, float]], (self.P_0, self.Q, self.R))
        return EkfTuning(P_0, Q, R, self.i_min, MODELS[self.model])


def _value(key: str, value: object) -> object:
    if key == "preset":
        return one_of("ekf preset", value, PRESETS)
    if key == "model":
        return one_of("ekf model", value, tuple(MODELS))
    if key in _VARIANCES:
        return _variances(key, value)
    low, high, unit = _RANGES[key]
    if key == "omega_e" and value is None:
        return None
    return number(f"ekf {key}", value, low, high, unit)


def _variances(key: str, value: object) -> tuple[float, ...]:
    count, least = _VARIANCES[key]
    given = list(cast(Sequence[object], value)) if isinstance(value, list | tuple) else []
    if len(given) != count:
        raise LimitError(f"ekf {key}: expected a list of {count} numbers, got {shown(cast(object, value))}")
    return tuple(number(f"ekf {key}", variance, least, _MOST) for variance in given)


def one_of(where: str, value: object, choices: Sequence[str]) -> Any:
    """A word out of some. Raises LimitError."""
    if not isinstance(value, str) or value not in choices:
        raise LimitError(f"{where}: expected {', '.join(choices[:-1])} or {choices[-1]}, got {shown(value)}")
    return value


def number(where: str, value: object, low: float, high: float, unit: str = "") -> float:
    """A number in a range. Raises LimitError."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        expected = f"{low:g} to {high:g} {unit}".rstrip()
        raise LimitError(f"{where}: expected a number of {expected}, got {shown(value)}")
    return float(value)
