"""A drive's live estimates as a table in the terminal, over the service's REST interface."""

import contextlib
import time
from typing import Any

from rich.console import Group
from rich.live import Live

from bench.cli.commands.control import state_words
from bench.cli.exit_codes import HOLDS, NOT_TOLD, code_of
from bench.cli.output import print_json
from bench.cli.rest import rest_at
from bench.cli.table import basis_of, clock, estimates_table
from bench.cli.terminal import Terminal
from bench.errors import BenchError

_PERIOD = 0.5  # s between two looks
_TIMEOUT = 3.0  # s for one answer


def show(name: str, service: str | None, *, once: bool, as_json: bool) -> int:
    """Print the table once, which JSON always is, or keep it up to date until Ctrl-C; the exit code.

    Raises BenchError.
    """
    console = Terminal()
    with rest_at(service, _TIMEOUT) as rest:
        if once or as_json:
            content = rest.call("GET", name, "estimates", key="estimates")
            if as_json:
                print_json(content)
            else:
                console.print(_table(content))
            if content["status"] in ("ok", "filling", "doubtful"):
                return code_of(content["estimates"])
            drive = rest.call("GET", name, key="link")
            if drive["link"]["state"] == "streaming":
                return NOT_TOLD
            said = drive["link"]["last_error"]
            raise BenchError(f"drive {name} is not there" + (f": {said['sentence']}" if said else ""))
        with contextlib.suppress(KeyboardInterrupt), Live(console=console, auto_refresh=False) as live:
            while True:
                live.update(_table(rest.call("GET", name, "estimates", key="estimates")), refresh=True)
                time.sleep(_PERIOD)
    return HOLDS


def _table(content: dict[str, Any]) -> Group:
    settings = content["window"]
    age = "no data yet" if content["age_s"] is None else f"{content['age_s']:.2f} s old"
    title = f"{content['drive']}: {_status(content)}"
    basis = f"{basis_of(settings, content['samples'])}, {content['gaps']} gaps, {age}"
    said = content["drive_state"]
    state = "not known, there is no link to it" if said["state"] is None else state_words(said)
    below = "\n".join(filter(None, (basis, f"drive: {state}", _mismatch(content))))
    return estimates_table(content, settings, below, title)


def _status(content: dict[str, Any]) -> str:
    """The status of all; which parameters it does not hold for, where it is ok."""
    if content["status"] != "ok":
        return str(content["status"]).replace("_", " ")
    untold = [name for name, estimate in content["estimates"].items() if estimate["status"] == "not_told"]
    return f"{', '.join(untold)} not told" if untold else "ok"


def _mismatch(content: dict[str, Any]) -> str:
    """Since when, and where, the parameters do not explain the drive; nothing where they always have."""
    said = content["mismatch"]
    if said["since"] is None:
        return ""
    since = clock(said["since"])
    if said["until"] is not None:
        return f"the model explains the drive; from {since} to {clock(said['until'])} it did not: {said['where']}"
    return (
        f"the model has not explained the drive since {since}: {said['where']}; "
        f"record and diagnose: pmsm-bench capture {content['drive']}"
    )
