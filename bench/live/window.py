"""The settings of an estimation: what a user may change while the stream runs. Knows nothing of streams."""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Final, Literal, cast

from bench.errors import LimitError, shown
from bench.live.tuning import Tuning, number, one_of
from estimator.machine import PARAMETERS, PLAUSIBLE, UNITS
from estimator.online.ekf import TELLABLE
from estimator.online.rls import SMALLEST_LAM
from estimator.online.window_ls import check_window

AUTO: Final = "auto"
METHODS: Final = ("wls", "rls", "ekf")


@dataclass(frozen=True, slots=True)
class Window:
    """Method, length, rows, the parameters to estimate, and values (SI) for those held.

    A setting that the method does not use is kept, and applies again when the method does: `length` and `longest` are
    those of wls, `periods_per_row` that of wls and rls, `forgetting_factor` that of rls, `ekf` that of ekf.
    """

    length: int | Literal["auto"] = 1000  # samples; "auto": each parameter's own, chosen by the data
    periods_per_row: int = 1  # m
    estimated: tuple[str, ...] = PARAMETERS
    held: Mapping[str, float] = field(default_factory=dict[str, float])
    method: Literal["wls", "rls", "ekf"] = "wls"
    longest: int = 10_000  # samples, with length "auto"
    forgetting_factor: float = 1.0  # lam
    ekf: Tuning = field(default_factory=Tuning)

    @property
    def samples(self) -> int:
        """The most samples that the window holds."""
        return self.longest if isinstance(self.length, str) else self.length

    @property
    def chosen_by_data(self) -> bool:
        """Each parameter uses the window that the data suit."""
        return self.method == "wls" and self.length == AUTO

    def changed(self, change: Mapping[str, Any]) -> "Window":
        """This window with some settings replaced. Raises LimitError, in a sentence, when it cannot work."""
        known = [f.name for f in fields(self)]
        for key in change:
            if key not in known:
                raise LimitError(f"expected {', '.join(known[:-1])} or {known[-1]}, got {shown(key)}")
        lam = change.get("forgetting_factor", self.forgetting_factor)
        window = replace(
            self,
            method=one_of("method", change.get("method", self.method), METHODS),
            length=AUTO if change.get("length", self.length) == AUTO else _whole(change, "length", self.length),
            longest=_whole(change, "longest", self.longest),
            periods_per_row=_whole(change, "periods_per_row", self.periods_per_row),
            estimated=_names(change.get("estimated", self.estimated)),
            held={**self.held, **_values(change.get("held", {}))},
            forgetting_factor=number("forgetting_factor", lam, SMALLEST_LAM, 1.0),
            ekf=self.ekf.changed(change.get("ekf", {})),
        )
        window._check(longest="longest" in change)
        return window

    def _check(self, *, longest: bool) -> None:
        """Raise LimitError where settings do not go together; `longest`: even if it is not in use."""
        m, parameters = self.periods_per_row, len(self.estimated)
        if not isinstance(self.length, str):
            _check_samples("", self.length, m, parameters)
        if longest or isinstance(self.length, str):
            _check_samples("longest: ", self.longest, m, parameters)
        for name in PARAMETERS:
            if name not in self.estimated and name not in self.held:
                raise LimitError(f"{name} is not estimated, so a held value in {UNITS[name]} is needed, got none")
        if self.method == "ekf":
            self._check_filter()

    def _check_filter(self) -> None:
        if not set(self.estimated) & set(TELLABLE):
            raise LimitError(f"method ekf estimates {', '.join(TELLABLE)} and holds the rest, got {self.estimated[0]}")
        if missing := [name for name in PARAMETERS if name not in self.held]:
            raise LimitError(
                f"method ekf starts from held values of {', '.join(PARAMETERS)}, got none of {', '.join(missing)}; "
                "give those in held"
            )


def _check_samples(where: str, samples: int, m: int, parameters: int) -> None:
    try:
        check_window(samples, m, parameters)
    except ValueError as error:
        raise LimitError(f"{where}{error}") from None


def _whole(change: Mapping[str, Any], key: str, otherwise: object) -> int:
    value = change.get(key, otherwise)
    if isinstance(value, bool) or not isinstance(value, int):
        or_auto = f' or "{AUTO}"' if key == "length" else ""
        raise LimitError(f"{key}: expected a whole number{or_auto}, got {shown(value)}")
    if abs(value) > 10**18:  # JSON's and TOML's integers have no end
        raise LimitError(f"{key}: expected a whole number of at most 18 digits, got {shown(value)}")
    return value


def _names(value: object) -> tuple[str, ...]:
    if not isinstance(value, Sequence) or isinstance(value, str):
        raise LimitError(f"estimated: expected a list of {', '.join(PARAMETERS)}, got {shown(value)}")
    names = cast(Sequence[object], value)
    for name in names:
        if name not in PARAMETERS:
            raise LimitError(f"estimated: expected {', '.join(PARAMETERS)}, got {shown(name)}")
    if not names:
        raise LimitError(f"estimated: expected at least one of {', '.join(PARAMETERS)}, got none")
    return tuple(name for name in PARAMETERS if name in names)


def _values(value: object) -> dict[str, float]:
    if not isinstance(value, Mapping):
        raise LimitError(f"held: expected values of {', '.join(PARAMETERS)}, got {shown(value)}")
    values: dict[str, float] = {}
    for name, given in cast(Mapping[str, object], value).items():
        if name not in PARAMETERS:
            raise LimitError(f"held: expected {', '.join(PARAMETERS)}, got {shown(name)}")
        if isinstance(given, bool) or not isinstance(given, int | float) or not 0 < given <= sys.float_info.max:
            raise LimitError(f"held {name}: expected a number of {UNITS[name]} above zero, got {shown(given)}")
        low, high = PLAUSIBLE[name]
        if not low <= given <= high:
            unit = UNITS[name]
            raise LimitError(f"held {name}: expected {low:g} to {high:g} {unit} (SI, per phase), got {shown(given)}")
        values[name] = float(given)
    return values
