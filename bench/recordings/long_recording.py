"""Long recordings in stretches: what of one is diagnosed, so that memory and time stay bounded however long it is.

A recording is read once to see what is in it, block by block, and once more for the blocks that are chosen: one in two
evenly over all of it, for what changes slowly; the others one by one, each where currents and speed are most unlike
those of all chosen before, so that no operating point is passed over. Knows nothing of files and their formats.
"""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bench.recordings.recording import Recording, RecordingReader, joined, one_of
from bench.recordings.runs import Chunk
from estimator.samples import LeftOut, Samples, turned_angle

MOST = 600_000  # rows that are diagnosed: a minute at 10 kHz
BLOCK = 6_000  # rows
_SLOWLY = 0.5  # share of the blocks that lie evenly over the recording
_FEATURES = ("i_d", "i_q", "omega_e")
_NOTHING = np.empty(0)

Open = Callable[[], AbstractContextManager[RecordingReader]]


def read_in_stretches(opened: Open, most: int = MOST) -> tuple[Recording, str]:
    """A recording, or so many rows of it where it is longer; and what is to be said of that. Raises RecordingError."""
    survey, kept = Survey(), list[Chunk]()
    with opened() as reader:
        for chunk in reader:
            survey.add(chunk)
            kept.append(chunk)
            if survey.rows > most:
                kept.clear()
        summary = reader.summary
    if survey.rows <= most:
        return Recording(tuple(joined(kept)), summary), ""
    chosen = survey.chosen(most)
    with opened() as reader:
        runs = tuple(_parts_of(reader, chosen))
    used = sum(map(len, runs))
    said = (
        f"a long recording: {used} of its {survey.rows} rows are diagnosed, in {len(runs)} stretches: half of them "
        "evenly over it, half where currents and speed differ most from all others; what shows only in between is not "
        "judged"
    )
    return Recording(runs, replace(summary, used=used)), said


class Survey:
    """What is in a recording: currents and speed of each block of its rows, mean and standard deviation."""

    def __init__(self) -> None:
        self._sums: list[NDArray[np.float64]] = []  # of each block: rows; sums of features and of their squares
        self.rows = 0  # so far

    def add(self, chunk: Chunk) -> None:
        """The next chunk of the recording."""
        for block, part in _blocks(chunk.samples, self.rows):
            features = [getattr(part, name) for name in _FEATURES]
            sums = np.array([float(len(part)), *(np.sum(x) for x in features), *(np.sum(x * x) for x in features)])
            if block < len(self._sums):
                self._sums[block] += sums
            else:
                self._sums.append(sums)
        self.rows += len(chunk.samples)

    def chosen(self, most: int) -> frozenset[int]:
        """Numbers of blocks that have so many rows at most."""
        sums, count = np.array(self._sums), max(most // BLOCK, 1)
        n, (mean, square) = sums[:, :1], np.split(sums[:, 1:] / sums[:, :1], 2, axis=1)
        scale = np.sqrt(np.sum(n * square, axis=0) / np.sum(n)) + 1e-300
        features = np.hstack((mean / scale, np.sqrt(np.maximum(square - mean**2, 0.0)) / scale))
        taken = np.linspace(0, len(sums) - 1, max(round(_SLOWLY * count), 1)).round().astype(int).tolist()
        distance = np.min([np.linalg.norm(features - features[block], axis=1) for block in taken], axis=0)
        while len(taken) < count:
            distance[taken] = -1.0
            taken.append(int(np.argmax(distance)))
            distance = np.minimum(distance, np.linalg.norm(features - features[taken[-1]], axis=1))
        return frozenset(taken)


def _blocks(samples: Samples, begin: int) -> Iterator[tuple[int, Samples]]:
    """The blocks that samples, of which the first is row `begin`, have parts of."""
    at = 0
    while at < len(samples):
        number = (begin + at) // BLOCK
        end = min((number + 1) * BLOCK - begin, len(samples))
        yield number, samples[at:end]
        at = end


def _parts_of(reader: RecordingReader, chosen: frozenset[int]) -> Iterator[Samples]:
    """The chosen blocks' rows, neighbours as one, with what is known of the rows between them and those before."""
    begin, between, parts = 0, _Between(), list[Samples]()
    for chunk in reader:
        if not chunk.joined:
            yield from _taken(parts)
            between.gap()
        for block, part in _blocks(chunk.samples, begin):
            if block in chosen:
                parts.append(replace(part, left_out=between.up_to(part)))
            else:
                yield from _taken(parts)
                between.passes(part)
        begin += len(chunk.samples)
    yield from _taken(parts)


def _taken(parts: list[Samples]) -> Iterator[Samples]:
    """All that are there, as one; none is there afterwards."""
    if parts:
        yield one_of(parts)
        parts.clear()


class _Between:
    """What has passed since the latest row that was taken."""

    def __init__(self) -> None:
        self._before = _NOTHING, _NOTHING  # angle and speed of the row before, of the same run
        self._turned: float | None = None  # rad; None where it is not known
        self._heat = 0.0  # A^2 s
        self._passed = False  # whether any row has

    def gap(self) -> None:
        """Rows are not there: nobody has counted the turns."""
        self._before, self._turned = (_NOTHING, _NOTHING), None

    def passes(self, part: Samples) -> None:
        """These rows are not taken."""
        self._turn(part)
        self._passed = True
        self._heat += part.T * float(np.sum(part.i_d**2 + part.i_q**2))

    def up_to(self, part: Samples) -> LeftOut | None:
        """What was between the latest row that was taken and these, which are; None for nothing."""
        self._turn(part[:1])
        told = LeftOut(self._turned, self._heat) if self._passed else None
        self._before, self._turned = (part.theta_e[-1:], part.omega_e[-1:]), 0.0
        self._heat, self._passed = 0.0, False
        return told

    def _turn(self, part: Samples) -> None:
        theta, omega = (np.concatenate(two) for two in zip(self._before, (part.theta_e, part.omega_e), strict=True))
        self._before = theta[-1:], omega[-1:]
        if self._turned is not None:
            self._turned += float(np.sum(turned_angle(theta, omega, part.T)))
