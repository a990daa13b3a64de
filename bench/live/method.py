"""The estimator that runs over one stream: the window always, and the recursion or the filter beside it where chosen.

The window takes every sample whatever the method, so that going back to it loses nothing. The recursion and the filter
begin with the first sample after they are chosen, or after a change that they cannot go on from: of `periods_per_row`
for the recursion; of `estimated`, `held` or `ekf` for the filter. Knows nothing of threads, drives or files.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from bench.live.window import Window
from estimator.online import auto_window, ekf, rls, window_ls
from estimator.online.ekf import TELLABLE, EkfState
from estimator.online.estimate import Estimate, Status, WindowEstimate
from estimator.online.rls import Prior, RlsState
from estimator.online.window_ls import WindowState
from estimator.samples import Samples

SPEED_ROWS = 100  # from which the filter learns the speed, where that is left to it


@dataclass(slots=True, eq=False)
class Filter:
    """The Kalman filter, which starts when it knows row time and speed."""

    state: EkfState | None = None
    waiting: list[tuple[Samples, bool]] = field(default_factory=list[tuple[Samples, bool]])  # and whether each joins


@dataclass(slots=True, eq=False)
class Running:
    """An estimator with its settings; `take` changes it in place."""

    window: Window
    samples: WindowState
    recursion: RlsState | None  # with method rls
    filter: Filter | None  # with method ekf


def start(window: Window) -> Running:
    """An estimator that has seen nothing."""
    return Running(window, window_ls.init(window.samples, window.periods_per_row), _recursion(window), _filter(window))


def take(running: Running, samples: Samples, *, joined: bool) -> None:
    """Take in consecutive samples; `joined`: they follow the last ones by exactly one row."""
    running.samples = window_ls.update(running.samples, samples, joined=joined)
    if running.recursion is not None:
        running.recursion = rls.update(running.recursion, samples, joined=joined)
    if running.filter is not None:
        _take(running.filter, running.window, samples, joined=joined)


def estimate(running: Running) -> WindowEstimate:
    """What it says now."""
    window = running.window
    if running.recursion is not None:
        return rls.estimate(running.recursion)
    if running.filter is not None:
        return _filtered(running.filter, window)
    if window.chosen_by_data:
        return auto_window.estimate(running.samples, window.estimated, window.held)
    return window_ls.estimate(running.samples, window.estimated, window.held)


def changed(running: Running, window: Window) -> Running:
    """This stream under other settings. The one given stays as it is, and must not take samples any more."""
    before = running.window
    samples = window_ls.resized(replace(running.samples), window.samples, window.periods_per_row)
    recursion, kalman = _recursion(window), _filter(window)
    if recursion is not None and running.recursion is not None and window.periods_per_row == before.periods_per_row:
        recursion = replace(
            running.recursion, estimated=recursion.estimated, held=recursion.held, prior=recursion.prior
        )
        recursion = rls.with_lam(recursion, window.forgetting_factor)
    if running.filter is not None and _filter_settings(window) == _filter_settings(before):
        kalman = running.filter
    return Running(window, samples, recursion, kalman)


def warm_up() -> None:
    """Compile the estimators' kernels; takes seconds at the very first start, then they are kept on disk."""
    window_ls.warm_up()
    rls.warm_up()
    ekf.warm_up()


def _recursion(window: Window) -> RlsState | None:
    if window.method != "rls":
        return None
    prior = Prior(dict(window.held))
    return rls.init(window.estimated, window.held, window.forgetting_factor, window.periods_per_row, prior)


def _filter(window: Window) -> Filter | None:
    return Filter() if window.method == "ekf" else None


def _filter_settings(window: Window) -> tuple[object, ...]:
    return window.method, window.estimated, window.held, window.ekf


def _take(kalman: Filter, window: Window, samples: Samples, *, joined: bool) -> None:
    if kalman.state is not None:
        kalman.state = ekf.update(kalman.state, samples, joined=joined)
        return
    if not np.isfinite(samples.omega_e).any():
        kalman.waiting.clear()  # a break, and nothing to learn from
        return
    kalman.waiting.append((samples, joined))
    speeds = np.abs(np.concatenate([waiting.omega_e for waiting, _ in kalman.waiting]))
    speeds = speeds[np.isfinite(speeds)][:SPEED_ROWS]
    if len(speeds) >= (SPEED_ROWS if window.ekf.learns_speed else 1):
        kalman.state = _started(window, float(speeds.max()), samples.T_s)
        for waiting, joins in kalman.waiting:
            kalman.state = ekf.update(kalman.state, waiting, joined=joins)
        kalman.waiting.clear()


def _started(window: Window, omega_e: float, T_s: float) -> EkfState:
    estimated = [name for name in TELLABLE if name in window.estimated]
    return ekf.init(window.held, window.held, estimated, window.ekf.for_filter(window.held, omega_e, T_s))


def _filtered(kalman: Filter, window: Window) -> WindowEstimate:
    """What the filter says, with a reason where that is not what was asked for."""
    state = kalman.state or _started(window, 0.0, 1.0)
    result = ekf.estimate(state)
    return replace(result, estimates={name: _explained(e, kalman, window) for name, e in result.estimates.items()})


def _explained(e: Estimate, kalman: Filter, window: Window) -> Estimate:
    if e.status is Status.HELD and e.name in window.estimated:
        return replace(e, reason="the Kalman filter holds it at the given value")
    if e.status is Status.NO_DATA and kalman.waiting:
        return replace(e, reason=f"the Kalman filter waits for {SPEED_ROWS} rows, to learn the speed from them")
    return e
