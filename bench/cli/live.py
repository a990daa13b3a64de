"""A drive's live estimates as a table in the terminal, over the service's REST interface."""

import contextlib
import time
from datetime import datetime
from typing import Any

import httpx
from rich.console import Console
from rich.live import Live
from rich.table import Table

from bench.cli.rest import Rest
from bench.cli.table import basis_of, estimates_table

_PERIOD = 0.5  # s between two looks
_TIMEOUT = 3.0  # s for one answer


def show(name: str, service: str, *, once: bool) -> None:
    """Print the table once, or keep it up to date until Ctrl-C. Raises BenchError when the service says no."""
    console = Console()
    with httpx.Client(timeout=_TIMEOUT) as client:
        rest = Rest(client, service)
        if once:
            console.print(_table(rest.call("GET", name, "estimates", key="estimates")))
            return
        with contextlib.suppress(KeyboardInterrupt), Live(console=console, auto_refresh=False) as live:
            while True:
                live.update(_table(rest.call("GET", name, "estimates", key="estimates")), refresh=True)
                time.sleep(_PERIOD)


def _table(content: dict[str, Any]) -> Table:
    settings = content["window"]
    age = "no data yet" if content["age_s"] is None else f"{content['age_s']:.2f} s old"
    title = f"{content['drive']}: {content['status'].replace('_', ' ')}"
    basis = f"{basis_of(settings, content['samples'])}, {content['gaps']} gaps, {age}"
    return estimates_table(content, settings, "\n".join(filter(None, (basis, _mismatch(content)))), title)


def _mismatch(content: dict[str, Any]) -> str:
    """Since when, and where, the parameters do not explain the drive; nothing where they always have."""
    said = content["mismatch"]
    if said["since"] is None:
        return ""
    since = _clock(said["since"])
    if said["until"] is not None:
        return f"the model explains the drive; from {since} to {_clock(said['until'])} it did not: {said['where']}"
    return (
        f"the model has not explained the drive since {since}: {said['where']}; "
        f"record and diagnose: pmsm-bench capture {content['drive']}"
    )


def _clock(time_utc: str) -> str:
    """Time of day here."""
    return datetime.fromisoformat(time_utc).astimezone().strftime("%H:%M:%S")
