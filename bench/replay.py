"""Replay: the streaming core over a recording, chunk by chunk in constant memory. Knows nothing of terminals."""

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass

from bench.recording import RecordingReader, Summary
from bench.runs import Chunk
from bench.window import Window
from estimator import window_ls
from estimator.estimate import WindowEstimate
from estimator.samples import Samples


@dataclass(frozen=True, slots=True)
class Replay:
    """What a recording's last window says."""

    recording: Summary
    window: Window
    result: WindowEstimate


OnEstimate = Callable[[float, WindowEstimate], None]
"""Called with the time (s) of a window's newest row's end, and what the window says."""


def replay(reader: RecordingReader, window: Window, every: int = 0, on_estimate: OnEstimate | None = None) -> Replay:
    """Stream a recording through the window; with `every`, report each time so many more rows have come."""
    state = window_ls.init(window.length, window.periods_per_row)
    due = every
    for chunk in reader:
        for piece, joined in _pieces(chunk, due, every):
            state = window_ls.update(state, piece, joined=joined)
            due -= len(piece)
            if every and due <= 0 and on_estimate is not None:
                on_estimate(piece.t0 + len(piece) * piece.T, _estimate(state, window))
                due = every
    return Replay(reader.summary, window, _estimate(state, window))


def as_json(replayed: Replay) -> dict[str, object]:
    """A replay as plain values, SI."""
    result, window = replayed.result, replayed.window
    return {
        "estimates": {name: asdict(estimate) for name, estimate in result.estimates.items()},
        "samples": result.samples,
        "gaps": result.gaps,
        "equations": result.equations,
        "condition": result.condition,
        "residual_rms_V": result.residual_rms,
        "window": {
            "length": window.length, "periods_per_row": window.periods_per_row,
            "estimated": list(window.estimated), "held": dict(window.held),
        },
        "recording": asdict(replayed.recording),
    }


def _estimate(state: window_ls.WindowState, window: Window) -> WindowEstimate:
    return window_ls.estimate(state, window.estimated, window.held)


def _pieces(chunk: Chunk, due: int, every: int) -> Iterator[tuple[Samples, bool]]:
    """A chunk cut where reports are due, and whether each piece follows the rows before it."""
    if not every:
        yield chunk.samples, chunk.joined
        return
    start, stop = 0, min(due, len(chunk.samples))
    while start < len(chunk.samples):
        yield chunk.samples[start:stop], chunk.joined or start > 0
        start, stop = stop, min(stop + every, len(chunk.samples))
