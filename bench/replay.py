"""Replay: the streaming core over a recording, chunk by chunk in constant memory. Knows nothing of terminals."""

import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass

import numpy as np

from bench import method
from bench.recording import RecordingReader, Summary
from bench.runs import Chunk
from bench.window import Window
from estimator.estimate import WindowEstimate
from estimator.samples import Samples


@dataclass(frozen=True, slots=True)
class Replay:
    """What a recording says at its end."""

    recording: Summary
    window: Window
    result: WindowEstimate
    remarks: tuple[str, ...]  # what a user should know besides, a sentence each


OnEstimate = Callable[[float, WindowEstimate], None]
"""Called with the time (s) at the newest row's end, and what the rows so far say."""


def replay(
    reader: RecordingReader, window: Window, every: int = 0, on_estimate: OnEstimate | None = None,
    on_rows: Callable[[int], None] | None = None,
) -> Replay:
    """Stream a recording through the estimator; with `every`, report each time so many more rows have come.

    `on_rows` hears the number of rows done, now and then.
    """
    running = method.start(window)
    due, turned = every, _Turned()
    for chunk in reader:
        turned.take(chunk.samples)
        if on_rows is not None:
            on_rows(reader.summary.rows)
        for piece, joined in _pieces(chunk, due, every):
            method.take(running, piece, joined=joined)
            due -= len(piece)
            if every and due <= 0 and on_estimate is not None:
                on_estimate(piece.t0 + len(piece) * piece.T, method.estimate(running))
                due = every
    return Replay(
        reader.summary, window, method.estimate(running), (*reader.summary.remarks(), *turned.remarks())
    )


def as_json(replayed: Replay) -> dict[str, object]:
    """A replay as plain values, SI."""
    result, window = replayed.result, replayed.window
    return {
        "method": window.method,
        "estimates": {name: asdict(estimate) for name, estimate in result.estimates.items()},
        "samples": result.samples,
        "gaps": result.gaps,
        "equations": result.equations,
        "condition": result.condition,
        "residual_rms_V": result.residual_rms,
        "combinations": [asdict(combination) for combination in result.combinations],
        "window": asdict(window),
        "remarks": list(replayed.remarks),
        "recording": asdict(replayed.recording),
    }


@dataclass(slots=True)
class _Turned:
    """Whether speed and angle of a recording tell the same; the estimator rests on the angle."""

    time: float = 0.0  # s
    by_angle: float = 0.0  # rad
    by_speed: float = 0.0  # rad
    path: float = 0.0  # rad, without sign

    def take(self, samples: Samples) -> None:
        by_speed = 0.5 * (samples.omega_e[:-1] + samples.omega_e[1:]) * samples.T
        off = np.diff(samples.theta_e) - by_speed
        off -= 2.0 * math.pi * np.round(off / (2.0 * math.pi))
        self.time += len(off) * samples.T
        self.by_speed += float(by_speed.sum())
        self.by_angle += float((by_speed + off).sum())
        self.path += float(np.abs(by_speed).sum())

    def remarks(self) -> tuple[str, ...]:
        if abs(self.by_angle - self.by_speed) <= 0.02 * self.path + 1.0:
            return ()
        return (
            f"theta_e turns at {self.by_angle / self.time:.4g} rad/s on average, but omega_e says "
            f"{self.by_speed / self.time:.4g} rad/s; the estimates rest on theta_e",
        )


def _pieces(chunk: Chunk, due: int, every: int) -> Iterator[tuple[Samples, bool]]:
    """A chunk cut where reports are due, and whether each piece follows the rows before it."""
    if not every:
        yield chunk.samples, chunk.joined
        return
    start, stop = 0, min(due, len(chunk.samples))
    while start < len(chunk.samples):
        yield chunk.samples[start:stop], chunk.joined or start > 0
        start, stop = stop, min(stop + every, len(chunk.samples))
