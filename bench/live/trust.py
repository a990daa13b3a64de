"""Trust: which live estimates may be called ok. What rests on old rows is stale, what does not fit is doubtful.

Numbers stay as they are; a status says how far to believe them. Judged whenever somebody asks, not when rows come, so
that what ends is told, too. Knows nothing of threads and HTTP.
"""

import time
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Final

from bench.live.acquisition import Link, LinkState
from bench.live.doubts import doubted
from bench.live.estimation import Snapshot, Stale
from bench.live.watch import Explained
from estimator.online.estimate import Estimate, Status

STALE: Final = 0.8  # s; with the way of a row and of an answer, nothing is called ok that is older than a second
_BRIDGE: Final = "the bridge is off, or the drive is in fault"


def trusted(snapshot: Snapshot, link: Link, drive_says: str = "") -> Snapshot:
    """A drive's estimates as they are to be believed now.

    `drive_says`: why the drive tells no voltage, a clause, where that is known.
    """
    said = snapshot.mismatch
    mismatch = f"the model does not explain the drive: {said.where}" if said.status is Explained.NO else ""
    snapshot = replace(snapshot, result=replace(snapshot.result, estimates=doubted(snapshot.result, mismatch)))
    age = snapshot.age
    if age is None or age <= STALE:
        return snapshot
    stale = Stale(datetime.now(UTC) - timedelta(seconds=age), _why(snapshot, link, drive_says or _BRIDGE))
    estimates = {name: _aged(e, stale.why) for name, e in snapshot.result.estimates.items()}
    shaft = snapshot.shaft if snapshot.shaft.since else replace(snapshot.shaft, since=stale.since, now=stale.why)
    return replace(snapshot, stale=stale, shaft=shaft, result=replace(snapshot.result, estimates=estimates))


def _aged(e: Estimate, why: str) -> Estimate:
    if e.status is Status.DOUBTFUL:
        return replace(e, status=Status.STALE, reason=f"{why}; and it was doubtful: {e.reason}")
    return replace(e, status=Status.STALE, reason=why) if e.status is Status.OK else e


def _lag(link: Link) -> float:
    """Seconds by which rows are old when they come, by the drive's tick."""
    if link.age is None or not link.arrivals:
        return 0.0
    return max(0.0, link.age - (time.monotonic() - link.arrivals[-1][0]))


def _why(snapshot: Snapshot, link: Link, drive_says: str) -> str:
    """Why no newer row is used, in a sentence."""
    if link.state is not LinkState.STREAMING:
        return f"the link is lost: {link.last_error.sentence}" if link.last_error else "the link is lost"
    if (lag := _lag(link)) > STALE:
        return f"the stream lags by {lag:.1f} s"
    if {"u_d", "u_q"} & set(snapshot.lacking):
        return f"no voltage is known: {drive_says}"
    if snapshot.lacking:
        return f"{', '.join(snapshot.lacking)} of the drive's rows are no numbers"
    if link.age is not None and link.age > STALE:
        return f"no row has come for {link.age:.1f} s, though the link stands"
    return "the estimation is behind the stream"
