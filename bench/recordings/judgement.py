"""Judgement: do constant parameters explain a recording? In windows, as `watch` does a stream, in constant memory.

Every window is fitted anew, so a window tells whether constant parameters explain it at all; what the windows say of
each parameter tells whether it was one value throughout. Knows nothing of files and terminals.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from bench.live.watch import MOST, STEADY, SURELY, Explained, figures_of, strange_of, where_of
from bench.live.window import Window
from estimator.diagnosis.intake.answered import answer_alone
from estimator.diagnosis.watch import FEWEST_WATCHED, mismatch_of
from estimator.diagnosis.words import number
from estimator.machine import PARAMETERS
from estimator.online import window_ls
from estimator.online.ekf import TELLABLE
from estimator.online.estimate import Estimate, Status
from estimator.samples import Samples

_MOVED: Final = 6.0  # standard errors, and
_MATTERS: Final = 0.02  # of a parameter's value, by which it differs between two windows: not one value


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the windows say. The figures are those of the window that is least explained."""

    status: Explained = Explained.NOT_TOLD
    windows: int = 0  # judged
    unexplained: int = 0  # of those
    since: float | None = None  # s, begin of the first window that is not explained
    until: float | None = None  # s, end of the last
    where: str = ""  # it acts, a clause: in the window that is least explained
    reason: str = ""  # a sentence, where none could be judged
    significance: float | None = None  # of what is left, in standard deviations of noise
    ratio: float | None = None  # its energy over that of noise
    rms_V: float | None = None  # of what stands above noise, V
    least_V: float | None = None  # of that, from which it matters, V
    ask: str = "pmsm-bench diagnose"  # what tells more

    def sentence(self) -> str:
        """In words."""
        if self.status is Explained.NOT_TOLD:
            return f"whether the equations fit cannot be told: {self.reason}"
        if self.status is Explained.YES:
            return "the equations fit: constant parameters explain the voltages to within their noise"
        often = "" if self.windows == 1 else f" in {self.unexplained} of {self.windows} windows"
        size = f", {number(self.rms_V)} V rms above noise" if self.rms_V else ""
        return (
            f"the model does not explain the recording{often}, from {self.since:.6g} to {self.until:.6g} s{size}: "
            f"{self.where}; what is missing: {self.ask}"
        )


@dataclass(slots=True)
class Judgement:
    """Takes a recording's rows in their order; `verdict` after the last."""

    window: Window
    nominal: Mapping[str, float]  # SI, those that are known
    _waiting: list[Samples] = field(default_factory=list[Samples])
    _rows: int = 0  # of those
    worst: tuple[Samples, ...] = ()  # the window that is least explained
    done: int = 0  # rows judged
    _said: Verdict = Verdict()
    _denied: list[tuple[int, int]] = field(default_factory=list[tuple[int, int]])  # rows that are not explained
    _least: dict[str, tuple[Estimate, float]] = field(default_factory=dict[str, tuple[Estimate, float]])
    _most: dict[str, tuple[Estimate, float]] = field(default_factory=dict[str, tuple[Estimate, float]])

    def take(self, samples: Samples) -> None:
        """Take in a run, or a part of one."""
        self._waiting.append(samples)
        self._rows += len(samples)
        while self._rows >= 2 * MOST:
            self._judge(self._taken(MOST))

    def verdict(self) -> Verdict:
        """What is said of the whole recording."""
        if self._rows:
            half = (self._rows + 1) // 2
            if self._rows > MOST:
                self._judge(self._taken(half))
            self._judge(self._taken(self._rows))
        return self._said

    def concerns(self, newest: int, rows: int | None) -> bool:
        """Whether rows up to the newest, so many or all, are among those judged that are not explained."""
        first = 0 if rows is None else newest - rows
        return any(begin < newest and end > first for begin, end in self._denied)

    def changes(self) -> dict[str, str]:
        """Parameters that are not one value throughout, each with a sentence."""
        found: dict[str, str] = {}
        for name, (low, t_low) in self._least.items():
            high, t_high = self._most[name]
            a, b = low.value or 0.0, high.value or 0.0
            std = ((low.std or 0.0) ** 2 + (high.std or 0.0) ** 2) ** 0.5
            if b - a > max(_MOVED * std, _MATTERS * b):
                (first, at), (then, later) = sorted(((a, t_low), (b, t_high)), key=lambda one: one[1])
                found[name] = (
                    f"it is not one value: {number(first)} {low.unit} at {at:.4g} s, {number(then)} {low.unit} at "
                    f"{later:.4g} s"
                )
        return found

    def _taken(self, rows: int) -> list[Samples]:
        """The oldest so many rows that wait."""
        found: list[Samples] = []
        self._rows -= rows
        while rows > 0:
            run = self._waiting[0]
            if len(run) <= rows:
                found.append(self._waiting.pop(0))
            else:
                found.append(run[:rows])
                self._waiting[0] = run[rows:]
            rows -= len(found[-1])
        return found

    def _judge(self, runs: list[Samples]) -> None:
        self.done += (rows := sum(map(len, runs)))
        estimates = self._estimates(runs, rows)
        left, said = mismatch_of(runs, estimates), self._said
        if left is None or not left.moves:
            reason = (
                f"fewer than {FEWEST_WATCHED} rows can be judged, or nothing in them tells the inductances"
                if left is None else _steady(runs)
            )  # fmt: skip
            self._said = said if said.windows else replace(said, reason=reason)
            return
        begin, end = runs[0].t0, runs[-1].t0 + len(runs[-1]) * runs[-1].T
        strange = strange_of(estimates, self.nominal, SURELY)
        denied = left.mismatch or bool(strange)
        if denied:
            self._deny(rows)
            if (answer := answer_alone(runs)) is not None:
                self._said = said if said.windows else replace(said, reason=answer.sentence)
                return
        self._note(estimates, 0.5 * (begin + end))
        said = replace(said, windows=said.windows + 1, reason="")
        if denied and (not said.unexplained or left.rms_V > (said.rms_V or 0.0)):
            said = replace(said, where=where_of(left, strange), **figures_of(left))
            self.worst = tuple(runs)
        elif said.significance is None:
            said = replace(said, **figures_of(left))
        if denied:
            since = begin if said.since is None else said.since
            said = replace(said, unexplained=said.unexplained + 1, since=since, until=end)
        self._said = replace(said, status=Explained.NO if said.unexplained else Explained.YES)

    def _deny(self, rows: int) -> None:
        """The newest so many rows are not explained."""
        self._denied.append((self.done - rows, self.done))
        if len(self._denied) > 1 and self._denied[-2][1] == self._denied[-1][0]:
            self._denied[-2:] = [(self._denied[-2][0], self._denied[-1][1])]

    def _estimates(self, runs: list[Samples], rows: int) -> dict[str, Estimate]:
        """What these rows alone say, with what the method holds at its value."""
        estimated = self.window.estimated
        if self.window.method == "ekf":
            estimated = tuple(name for name in TELLABLE if name in estimated)
        state = window_ls.init(max(rows, len(PARAMETERS)))
        for run in runs:
            state = window_ls.update(state, run, joined=False)
        return window_ls.estimate(state, estimated, self.window.held).estimates

    def _note(self, estimates: Mapping[str, Estimate], t: float) -> None:
        for name, e in estimates.items():
            if e.status is Status.OK and e.value is not None:
                self._least[name] = min(self._least.get(name, (e, t)), (e, t), key=_value)
                self._most[name] = max(self._most.get(name, (e, t)), (e, t), key=_value)


def _value(one: tuple[Estimate, float]) -> float:
    return one[0].value or 0.0


def _steady(runs: Sequence[Samples]) -> str:
    """Why a window in which no current moves tells nothing."""
    answer = answer_alone(runs)
    return STEADY if answer is None else answer.sentence
