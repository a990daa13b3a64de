"""`pmsm-bench start`, `stop`, `reset`: a drive's state from the terminal, over the service's REST interface."""

from typing import Any

from bench.cli.commands.signals import pairs_of, read_from
from bench.cli.output import print_json
from bench.cli.rest import rest_at
from bench.cli.terminal import Terminal, plain
from bench.errors import BenchError
from drivers.wire.dictionary import SET_POINTS

_TIMEOUT = 15.0  # s for one answer
_console = Terminal(soft_wrap=True)


def start(name: str, given: list[str], service: str | None, *, as_json: bool) -> None:
    """Start a drive with set points given as SIGNAL=VALUE, and tell which it has. Raises BenchError."""
    said = _ask(name, "start", service, pairs_of(given), as_json=as_json)
    with rest_at(service, _TIMEOUT) as rest:
        told = read_from(rest, name, SET_POINTS)
    if as_json:
        print_json({"drive": name, **said, "set_points": told})
        return
    has = ", ".join(f"{one['name']} = {plain(float(one['value']))} {one['unit']}" for one in told if one["value"])
    _console.print(f"set points: {has or 'none, no current flows'}")


def stop(name: str, service: str | None, *, as_json: bool) -> None:
    """Stop a drive. Raises BenchError, also where it does not say that it is off."""
    said = _ask(name, "stop", service, as_json=as_json)
    if as_json:
        print_json({"drive": name, **said})
    if said["state"] in (None, "operation enabled"):
        raise BenchError(f"drive {name} does not say that it is off: it is {said['state'] or 'not to be had'}")


def reset(name: str, service: str | None, *, as_json: bool) -> None:
    """Reset a drive's fault. Raises BenchError."""
    said = _ask(name, "reset", service, as_json=as_json)
    if as_json:
        print_json({"drive": name, **said})


def words(control: dict[str, Any]) -> str:
    """A drive's state and who controls it, a clause."""
    if control["state"] is None:
        return "no link to the drive"
    if control["ours"]:
        said = control["whom"] or ""
        whom = "controlled by this service"
        by_job = control["in_experiment"] or control["in_flash"]
        whom += f" for {said}" if by_job else f", started from {said}" if said else ""
    else:
        whom = f"controlled by {control['holder']}" if control["holder"] else "controlled by nobody"
    return f"{state_words(control)}; {whom}"


def state_words(said: dict[str, Any]) -> str:
    """A drive's state, and what to do where it is in fault, a clause."""
    fault = said["fault"]
    return str(said["state"]) + (f", {fault['name']} ({fault['code']}): {fault['advice']}" if fault else "")


def _ask(
    name: str, what: str, service: str | None, body: dict[str, float] | None = None, *, as_json: bool
) -> dict[str, Any]:
    """The drive's state after it, which is told in words unless it is to be JSON."""
    with rest_at(service, _TIMEOUT) as rest:
        said = rest.call("POST", name, what, body=body or {}, key="state")
    if as_json:
        return said
    _console.print(f"{name}: {words(said)}")
    if said["guarded"] is False:
        _console.print(
            "this drive has no control lease, only a watchdog that any client's request feeds: a second client keeps "
            "it running, and may write to it",
        )  # fmt: skip
    return said
