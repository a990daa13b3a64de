"""What is asked of a diagnosis, and what comes of it, as processes hand them on. Knows nothing of how it is done."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Final, Protocol

from pydantic import Field, TypeAdapter

from bench.errors import ConfigError
from bench.expected import Else, Table, by_name, taken
from bench.machine_file import Nominal
from estimator.machine import PARAMETERS, Machine
from estimator.witness import Witness

WORK: Final = "bench.diagnoses.diagnose:work"  # takes a Request and a Tell, gives a Result
COMPILING: Final = "compiling, once"  # a phase: kernels that are not on disk yet
MOST_TRUST: Final = 10.0  # share
SETTLED: Final = ("no_mismatch", "explained")  # verdicts that leave nothing open
_Share = Annotated[float, Field(strict=True, gt=0, le=MOST_TRUST), Else(
    f"expected a share above 0 and at most {MOST_TRUST:g} ({100 * MOST_TRUST:g} %), such as 0.2 for 20 %"
)]  # fmt: skip
Trust = Annotated[
    dict[str, float], Table("expected an object", "expected {all}, got {key}", dict.fromkeys(PARAMETERS, _Share)),
    Field(description="how far off the nominal R_s, L_d, L_q, psi_f may be, as shares; 0.1 each",
          examples=[{"R_s": 0.2}]),
]  # fmt: skip
_TRUST: Final = TypeAdapter[dict[str, float]](Trust)


class Tell(Protocol):
    """Hears the share that is done, 0 to 1, and what is being done, in words."""

    def __call__(self, share: float, phase: str) -> None: ...


@dataclass(frozen=True, slots=True)
class Request:
    """A recording and what is known of its machine."""

    file: Path
    nominal: Nominal
    trust: Mapping[str, float] = field(default_factory=dict[str, float])  # tolerance of nominal values, as a share
    mapping: Mapping[str, str] = field(default_factory=dict[str, str])
    constants: Mapping[str, float] = field(default_factory=dict[str, float])
    align: Mapping[str, float] = field(default_factory=dict[str, float])
    report: bool = False
    format: str = "recording"  # of `bench.diagnoses.formats`, or "auto"
    witnesses: Mapping[str, Witness] = field(default_factory=dict[str, Witness])


@dataclass(frozen=True, slots=True)
class Result:
    """A diagnosis in texts."""

    content: dict[str, Any]  # as `bench.diagnoses.published` says
    machine: str | None  # a machine file; None where nothing was fitted
    report: str | None  # HTML
    figures: str  # JSON, as `bench.diagnoses.figures.figure` says


def check_whole(nominal: Nominal) -> Machine:
    """The nominal machine. Raises ConfigError where it is not whole."""
    machine = nominal.machine
    if machine is None:
        known = {**nominal.given, **({} if nominal.n_p is None else {"n_p": nominal.n_p})}
        missing = ", ".join(name for name in (*PARAMETERS, "n_p") if name not in known)
        raise ConfigError(f"a diagnosis needs the nominal machine whole, missing in [machine]: {missing}")
    return machine


def json_text(content: Mapping[str, Any]) -> str:
    """A diagnosis as it is written to files."""
    return json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def trust_of(items: Sequence[str]) -> dict[str, float]:
    """`R_s=20%,L_d=0.1` as shares. Raises ConfigError."""
    return checked_trust({name: _share(name, text) for name, text in by_name(items, "trust").items()})


def checked_trust(given: Mapping[str, object]) -> dict[str, float]:
    """Tolerances by parameter as shares. Raises ConfigError."""
    return taken(_TRUST, given, "trust:", ConfigError)


def _share(name: str, text: str) -> object:
    number = text.removesuffix("%").strip()
    try:
        share = float(number) / 100 if text.endswith("%") else float(number)
    except ValueError:
        return text
    if 1.0 < share < math.inf and not text.endswith("%"):
        raise ConfigError(f"trust: {name}: expected per cent, such as 20%, or a share up to 1, got {text}")
    return share
