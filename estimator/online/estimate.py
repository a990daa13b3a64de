"""An estimate: a value that never travels without its standard error, unit and status."""

from dataclasses import dataclass
from enum import StrEnum


class Status(StrEnum):
    """How far a value may be trusted."""

    OK = "ok"  # estimated from the window
    DOUBTFUL = "doubtful"  # estimated, but the equations do not fit: value and standard error may both be wrong
    STALE = "stale"  # estimated from rows that are too old to be taken for what is now
    HELD = "held"  # not estimated: held at the given value
    NOT_TOLD = "not_told"  # the window cannot tell it; the value, if any, is the held one
    NO_DATA = "no_data"  # the window is empty or has fewer rows than parameters


@dataclass(frozen=True, slots=True)
class Estimate:
    """One parameter. `value` and `std` in `unit` (SI); None where there is nothing honest to say."""

    name: str
    value: float | None
    std: float | None  # standard error; None unless status is ok, doubtful or stale
    unit: str
    status: Status
    reason: str = ""  # a sentence, where status is not ok
    window: int | None = None  # samples it rests on, where the data chose them


@dataclass(frozen=True, slots=True)
class Combination:
    """Parameters that a window cannot tell apart, or one that it cannot tell at all."""

    parameters: tuple[str, ...]
    reason: str  # a sentence


@dataclass(frozen=True, slots=True)
class WindowEstimate:
    """What one window says."""

    estimates: dict[str, Estimate]  # by parameter, in the order of `machine.PARAMETERS`
    samples: int  # rows in the window
    gaps: int  # breaks in the stream inside the window
    equations: int  # regression equations they make: two for each m rows
    filled: bool  # the window has as many rows as asked for
    condition: float | None  # of the column-scaled regressor matrix of the estimated parameters
    residual_rms: float | None  # V
    left_out: int = 0  # samples refused since the start because a value was not finite
    combinations: tuple[Combination, ...] = ()  # what the window cannot tell; no parameter is in two of them
    impossible: tuple[str, ...] = ()  # parameters that come out as no motor has them: the equations do not fit
