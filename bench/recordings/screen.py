"""Screen: a recording's rows without those that no machine makes, stretch by stretch in constant memory.

Left out, as gaps, and counted: rows that repeat (`bad_samples`), and the few that constant parameters miss by far
(`odd_rows`). Knows nothing of files and methods.
"""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bench.recordings.recording import one_of
from bench.recordings.runs import Chunk
from estimator.arrays import stretches
from estimator.diagnosis.intake.bad_samples import Account, Found, repeated, time_of
from estimator.diagnosis.intake.odd_rows import FAR, Odd, Usual, odd_rows
from estimator.samples import Samples

Bools = NDArray[np.bool_]

ROWS: Final = 65_536  # looked at together, at least
_CONTEXT: Final = 16  # rows before them, already handed on


class Screen:
    """Takes chunks in their order, hands on what is left of them; `finish` after the last."""

    def __init__(self) -> None:
        self._waiting: list[Chunk] = []
        self._rows = 0
        self._before: Chunk | None = None  # the newest rows handed on
        self._cut = False  # the newest row handed on is bad, as the rows after it have shown
        self._fitted: Usual | None = None
        self._repeated, self._odd = Account(), Account()

    def take(self, chunk: Chunk) -> Iterator[Chunk]:
        """The chunks that can be handed on with this one."""
        self._waiting.append(chunk)
        self._rows += len(chunk.samples)
        if self._rows >= ROWS:
            yield from self._looked_at()

    def finish(self) -> Iterator[Chunk]:
        """The rest."""
        if self._waiting:
            yield from self._looked_at()

    def remarks(self) -> tuple[str, ...]:
        """What was left out, a sentence each kind."""
        return tuple(said for said in (self._repeated.remark(), self._odd.remark()) if said)

    def _looked_at(self) -> Iterator[Chunk]:
        chunks, before = self._waiting, self._before
        self._waiting, self._rows = [], 0
        if before is not None and chunks[0].joined:
            chunks = [before, *chunks]
        else:
            before = None
        runs, places = _runs(chunks)
        bad = self._bad(runs, 0 if before is None else len(before.samples))
        for chunk, (k, at) in zip(chunks, places, strict=True):
            here = bad[k][at : at + len(chunk.samples)]
            if chunk is before:
                self._cut = bool(here[-1])
                continue
            yield from self._parts(chunk, here)
        last = chunks[-1]
        self._before = Chunk(last.samples[max(0, len(last.samples) - _CONTEXT) :], last.run, last.joined)

    def _bad(self, runs: Sequence[Samples], known: int) -> list[Bools]:
        """Bad rows of each run; the first so many rows of the first have been handed on and are not counted again."""
        again = [np.arange(len(run)) < (known if k == 0 else 0) for k, run in enumerate(runs)]
        found = repeated(runs)
        left = [run[a:b] for run, one in zip(runs, found, strict=True) for a, b in stretches(~one.bad)]
        odd = odd_rows(left, self._fitted) if left else Odd((), self._fitted)
        self._fitted = odd.fitted or self._fitted
        each = iter(odd.bad)
        bad: list[Bools] = []
        for run, one, old in zip(runs, found, again, strict=True):
            missed = np.zeros(len(run), np.bool_)
            for a, b in stretches(~one.bad):
                missed[a:b] = next(each)
            self._repeated.add(Found(one.bad & ~old, one.says))
            self._odd.add(Found(missed & ~old, partial(_said, run)))
            bad.append(one.bad | missed)
        return bad

    def _parts(self, chunk: Chunk, bad: Bools) -> Iterator[Chunk]:
        joined = chunk.joined and not self._cut
        for a, b in stretches(~bad):
            yield Chunk(chunk.samples[a:b], chunk.run, joined and a == 0)
        self._cut = bool(bad[-1]) if len(bad) else self._cut


def _said(run: Samples, a: int, b: int) -> str:
    until = "" if b - a == 1 else f" to {time_of(run, b - 1)}"
    return f"the row at {time_of(run, a)}{until} does not go with those around it, by over {FAR:g} times the noise"


def _runs(chunks: Sequence[Chunk]) -> tuple[list[Samples], list[tuple[int, int]]]:
    """Joined chunks as one, and where each of them is: which run, from which row on."""
    parts: list[list[Samples]] = []
    places: list[tuple[int, int]] = []
    for k, chunk in enumerate(chunks):
        if k == 0 or not chunk.joined:
            parts.append([])
        places.append((len(parts) - 1, sum(map(len, parts[-1]))))
        parts[-1].append(chunk.samples)
    return [one_of(part) for part in parts], places
