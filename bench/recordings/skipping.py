"""A recording whose rows skip control periods, replayed: one row in ten, say, each the values of one period.

Where the control period is known, by a machine file or `T_s`, its rows say so themselves. Where it is not, and no flux
balance of every period explains the rows, they may be such rows: then several control periods up to half a row are
tried, and what those that explain them change is in the standard errors. Knows nothing of terminals.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from bench.live.doubts import doubted
from bench.live.watch import SURELY, Explained, strange_of
from bench.live.window import Window
from bench.recordings.judgement import Verdict
from estimator.diagnosis.words import number
from estimator.online import skipping_rows
from estimator.online.estimate import Estimate, Status, WindowEstimate
from estimator.online.skipping_rows import Skipping, SkippingState
from estimator.samples import Samples

SLOWEST: Final = 4e-4  # s, that a control period is taken to last: rows further apart may skip some
_TRIED: Final = (0.02, 0.1, 0.25, 0.5)  # of a row, control periods that are tried where it is not known
_NOT_EXPLAINED: Final = "the model does not explain these rows"
_EVERY_PERIOD: Final = "pmsm-bench diagnose, of a recording of every control period"


@dataclass(frozen=True, slots=True)
class Said:
    """What such rows say; no estimate is ok of an equation that does not fit."""

    result: WindowEstimate
    verdict: Verdict
    remark: str

    @property
    def explains(self) -> bool:
        """The rows fit, and tell all that is asked for."""
        told = all(e.status in (Status.OK, Status.HELD) for e in self.result.estimates.values())
        return self.verdict.status is Explained.YES and told


@dataclass(slots=True)
class SkippingRows:
    """Takes a recording's samples in their order. `T_s`: s, control period; None: not known."""

    T_s: float | None
    _states: list[SkippingState] = field(default_factory=list[SkippingState])
    _begin: float = math.nan  # s
    _end: float = math.nan  # s

    def take(self, samples: Samples, *, joined: bool) -> None:
        """Take in a run, or a part of one."""
        if not self._states:
            T = samples.T
            tried = [share * T for share in _TRIED] if self.T_s is None else [self.T_s]
            self._states = [skipping_rows.init(T_s) for T_s in tried]
            self._begin = samples.t0
        self._end = samples.t0 + len(samples) * samples.T
        for state in self._states:
            skipping_rows.update(state, samples, joined=joined)

    def finish(self) -> None:
        """The recording has ended."""
        for state in self._states:
            skipping_rows.finish(state)

    def said(self, window: Window, *, over: str = "", nominal: Mapping[str, float] | None = None) -> Said | None:
        """What they say so far, by the settings; None before any has come. `over`: what else speaks against them, as
        values (SI) do that the machine should have.
        """
        if not self._states:
            return None
        found = {
            state.T_s: skipping_rows.estimate(state, window.estimated, window.held) for state in self._states
        }
        least = min(found, key=lambda T_s: found[T_s].persistent_V)
        explain = {T_s: each for T_s, each in found.items() if not each.mismatch} or {least: found[least]}
        one, result = next(iter(explain.values())), _between([each.result for each in explain.values()])
        strange = strange_of(result.estimates, nominal or {}, SURELY)
        mismatch = "; ".join(filter(None, (over, *strange.values(), _NOT_EXPLAINED if one.mismatch else "")))
        result = replace(result, estimates=doubted(result, mismatch))
        return Said(result, self._verdict(one), self._remark(one, list(explain)))

    def _verdict(self, one: Skipping) -> Verdict:
        if one.degree == 0:
            return Verdict(reason=next(e.reason for e in one.result.estimates.values()))
        status = Explained.NO if one.mismatch else Explained.YES
        verdict = Verdict(
            status, 1, int(one.mismatch), significance=one.significance, rms_V=one.persistent_V, least_V=one.least_V,
            ask=_EVERY_PERIOD,
        )
        if not one.mismatch:
            return verdict
        return replace(
            verdict, since=self._begin, until=self._end, where="it hangs together over more rows than noise does"
        )

    def _remark(self, one: Skipping, explain: Sequence[float]) -> str:
        state = self._states[0]
        which = "one row in several control periods" if self.T_s is None else f"one row in {round(state.T / state.T_s)}"
        said = [f"{which}, each taken for the values of that control period"]
        if one.degree:
            said.append(
                f"slopes are those of polynomials of degree {one.degree} through {one.used} of {state.samples} rows, "
                "which no step is next to"
            )
        if self.T_s is None:
            few, many = (number(1e3 * T_s) for T_s in (min(explain), max(explain)))
            said.append(f"control periods of {few} to {many} ms explain them, and all are meant: --set T_s=...")
        return "; ".join(said)


def _between(results: Sequence[WindowEstimate]) -> WindowEstimate:
    """What several control periods say as one; what one of them does not tell is not told."""
    first = results[0]
    estimates: dict[str, Estimate] = {}
    for name, e in first.estimates.items():
        each = [result.estimates[name] for result in results]
        values = [one.value for one in each if one.status is Status.OK and one.value is not None]
        if len(values) == len(each):
            low, high, std = min(values), max(values), max(one.std or 0.0 for one in each)
            estimates[name] = replace(e, value=0.5 * (low + high), std=math.hypot(std, 0.5 * (high - low)))
        else:
            estimates[name] = next(one for one in each if one.status is not Status.OK)
    return replace(first, estimates=estimates)
