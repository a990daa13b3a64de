"""What a diagnosis says. Values travel with unit and standard error; arrays for pictures travel beside them.

A text annotated to a field is what a reader of the published diagnosis is told of it. Knows nothing of how it was
found.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Annotated

from estimator.arrays import Array


class Verdict(StrEnum):
    """The answer in a word."""

    NO_MISMATCH = "no_mismatch"
    EXPLAINED = "explained"
    PARTLY_EXPLAINED = "partly_explained"
    UNEXPLAINED = "unexplained"
    AMBIGUOUS = "ambiguous"
    NOT_ENOUGH_EXCITATION = "not_enough_excitation"


@dataclass(frozen=True, slots=True)
class Quantity:
    """A value with its standard error, both in `unit`; None where nothing honest can be said."""

    value: float | None
    std: Annotated[float | None, "standard error, in the same unit"]
    unit: str


@dataclass(frozen=True, slots=True)
class Range:
    """From the least to the most that a number may be."""

    least: float
    most: float


@dataclass(frozen=True, slots=True)
class Place:
    """Where a mismatch acts."""

    sentence: str
    region: Annotated[
        Mapping[str, float | str | tuple[float, float]],  # e.g. {"i_q": (2.0, 5.1), "axis": "q"}; SI
        "the smallest region that holds most of the mismatch: a value, or a range, by quantity, SI",
    ]
    energy_share: Annotated[float, "of the mismatch's energy"]  # 0 to 1
    samples_share: Annotated[float, "of the recording's rows"]  # 0 to 1


@dataclass(frozen=True, slots=True)
class Rival:
    """Another effect in the place of the one found."""

    effect: str
    odds: Annotated[float, "how many times likelier the finding is"]


@dataclass(frozen=True, slots=True)
class Finding:
    """An effect that was left out."""

    effect: str
    parameters: Mapping[str, Quantity]
    where: Place
    odds_against_next: Annotated[float, "against the likeliest explanation without it"]
    rivals: Annotated[tuple[Rival, ...], "other effects in its place, the likeliest first"]
    absorbed_as: Annotated[Mapping[str, float], "what it did to R_s, L_d, L_q, psi_f of a fit without it; SI"]
    equation: tuple[float, ...] = ()  # its equation's parameters, in their order; none where no twin has one


@dataclass(frozen=True, slots=True)
class Hold:
    """Levels that a drive is to hold."""

    speed_rpm: Annotated[float, "mechanical"]
    i_d: Annotated[float, "A"]
    i_q: Annotated[float, "A"]
    seconds: float


@dataclass(frozen=True, slots=True)
class Experiment:
    """What a drive is to be commanded, as `pmsm-bench experiment` does; empty where no drive could do it."""

    sentence: str
    speeds_rpm: Annotated[tuple[float, ...], "levels, mechanical"] = ()  # as the holds have them
    i_d: Annotated[tuple[float, ...], "A, levels"] = ()
    i_q: Annotated[tuple[float, ...], "A, levels"] = ()
    duration: Annotated[float, "s"] = 0.0
    holds: Annotated[tuple[Hold, ...], "one after the other"] = ()
    step: Annotated[float, "A, random steps of i_d and i_q within +- this around each"] = 0.0
    odds: Annotated[float | None, "to be expected against the likeliest rival"] = None


@dataclass(frozen=True, slots=True)
class Ambiguity:
    """Effects that this recording cannot tell apart, or from none."""

    effects: tuple[str, ...]
    reason: str
    experiment: Annotated[Experiment, "what would tell"]
    rivals: Annotated[
        bool, "one of the effects is there, and which is not told; false: it is not told whether any is"
    ] = True
    machine_holds: Annotated[
        bool, "R_s, L_d, L_q, psi_f and what is found hold, with their intervals, whichever of the effects is there"
    ] = False


@dataclass(frozen=True, slots=True)
class Unexplained:
    """What is left and has no name in the library."""

    rms_V: float
    where: Place
    description: str


@dataclass(frozen=True, slots=True)
class Change:
    """A number without the effects and with them."""

    before: float
    after: float


@dataclass(frozen=True, slots=True)
class ErrorChange(Change):
    """An error without the effects and with them, beside what noise alone makes it."""

    noise_floor: float | None = None


@dataclass(frozen=True, slots=True)
class LeaveOneOut:
    """How well groups of rows are predicted by a fit to all others, each in its turn."""

    left_out: Annotated[str, "what is left out at a time"]
    groups: int
    before: Annotated[float, "rms, without the effects"]
    after: Annotated[float, "with them"]
    unit: str
    alternatives: Annotated[Mapping[str, float], "rms of other models, by name"]


@dataclass(frozen=True, slots=True)
class Fit:
    """How well the model follows."""

    held_out: Annotated[bool, "judged on stretches that took no part in the fit"]
    one_step_rms_V: ErrorChange
    free_run_rms_A: Change
    explained: Annotated[float, "share of the mismatch's variance"]  # 0 to 1
    whiteness: Annotated[Change, "the residual's power below a tenth of the sampling rate over that of white noise"]
    leave_one_out: Annotated[
        LeaveOneOut | None,
        "where the fit is judged by leaving out groups of rows, each in its turn; one_step_rms_V is that",
    ] = None


@dataclass(frozen=True, slots=True)
class Candidate:
    """An effect by how much it would help, alone and on top of what was found."""

    effect: str
    log10_odds_alone: Annotated[float, "against no effect at all"]
    log10_odds_after: Annotated[float, "in favour of having it in the final set"]
    chosen: bool


@dataclass(frozen=True, slots=True, eq=False)
class Map:
    """Rms of the mismatch over two quantities; NaN where there are no rows."""

    x: str  # quantity and unit, for an axis
    y: str
    x_edges: Array  # (nx + 1,)
    y_edges: Array  # (ny + 1,)
    before_V: Array  # (ny, nx)
    after_V: Array  # (ny, nx)


@dataclass(frozen=True, slots=True, eq=False)
class Traces:
    """Series for pictures: a one-step residual before and after, in V. Rms values are of d and q together.

    In time and in maps it is that of means over some periods, in spectra that of single ones.
    """

    t: Array  # s, bins over the recording
    before_V: Array  # rms in each bin
    after_V: Array
    window_t: Array  # s, a short stretch where the mismatch is largest
    window: Mapping[str, tuple[Array, Array]]  # "u_d", "u_q": residual before, after, V
    window_i: Mapping[str, tuple[Array, Array, Array]]  # "i_d", "i_q": measured, free run before, after, A
    frequency: Array  # Hz
    spectrum: tuple[Array, Array]  # amplitude density before, after, V/sqrt(Hz)
    maps: tuple[Map, ...]
    periods: int = 1  # that means are over
    floor_V: float | None = None  # rms that noise alone leaves of such means


@dataclass(frozen=True, slots=True, eq=False)
class Scatter:
    """Residuals of rows left out over a quantity, for a picture."""

    x: str  # quantity and unit, for an axis
    y: str
    of_x: Array
    before_V: Array
    after_V: Array


@dataclass(frozen=True, slots=True, eq=False)
class FluxTable:
    """Flux linkages over currents, Vs: a row for each i_d, a column for each i_q.

    NaN, in JSON null, where neither the recording nor its mirror image in i_q has been.
    """

    i_d: Annotated[Array, "A"]  # (n,)
    i_q: Annotated[Array, "A"]  # (m,)
    psi_d: Array  # (n, m), as all that follow
    psi_q: Array
    psi_d_std: Array
    psi_q_std: Array


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """The whole answer."""

    verdict: Verdict
    sentence: Annotated[str, "the answer in words"]
    findings: Annotated[tuple[Finding, ...], "effects that were left out"]
    ambiguous: tuple[Ambiguity, ...]
    unexplained: Unexplained | None
    detectable: Annotated[
        Mapping[str, Quantity], "by effect, the smallest size that this recording would have shown at 99 % power"
    ]
    machine_before: Mapping[str, Quantity]
    machine_after: Mapping[str, Quantity]
    fit: Fit | None  # None where nothing could be fitted
    candidates: tuple[Candidate, ...]
    remarks: Annotated[tuple[str, ...], "what is wrong with the recording, and what to record instead"]
    traces: Traces | None
    experiment: Annotated[
        Experiment | None, "what to record instead, where this recording does not tell R_s, L_d, L_q and psi_f"
    ] = None
    scatters: tuple[Scatter, ...] = ()  # of steady points
    pole_pairs: int | None = None  # where the nominal ones are wrong
    scales: Mapping[str, Range] = field(default_factory=dict[str, Range])  # see `common_scale`
    flux_map: Annotated[
        FluxTable | None, "where no saturation curve of few numbers bends as the machine does"
    ] = None
    angle: float = 0.0  # rad electrical, that the recorded angle is ahead of the rotor's, within a count


def verdict_of(
    findings: Sequence[object], doubts: Sequence[Ambiguity], left: Unexplained | None, unidentified: Sequence[str]
) -> Verdict:
    """The answer in a word. `unidentified`: what a recording does not tell of the machine."""
    if doubts:
        return Verdict.AMBIGUOUS
    if findings:
        return Verdict.EXPLAINED if left is None else Verdict.PARTLY_EXPLAINED
    if left is not None:
        return Verdict.UNEXPLAINED
    return Verdict.NOT_ENOUGH_EXCITATION if unidentified else Verdict.NO_MISMATCH


def odds_of(log_odds: float) -> float:
    """Odds, within what a number shows."""
    return math.exp(min(max(log_odds, -50.0), 50.0))
