"""A drive's live estimates as a table in the terminal, over the service's REST interface."""

import contextlib
import time
from typing import Any, cast
from urllib.parse import quote

import httpx
from rich.console import Console
from rich.live import Live
from rich.table import Table

from bench.cli.table import basis_of, estimates_table
from bench.errors import BenchError

_PERIOD = 0.5  # s between two looks
_TIMEOUT = 3.0  # s for one answer


def show(name: str, service: str, *, once: bool) -> None:
    """Print the table once, or keep it up to date until Ctrl-C. Raises BenchError when the service says no."""
    console = Console()
    with httpx.Client(timeout=_TIMEOUT) as client:
        if once:
            console.print(_table(_get(client, name, service)))
            return
        with contextlib.suppress(KeyboardInterrupt), Live(console=console, auto_refresh=False) as live:
            while True:
                live.update(_table(_get(client, name, service)), refresh=True)
                time.sleep(_PERIOD)


def _get(client: httpx.Client, name: str, service: str) -> dict[str, Any]:
    try:
        response = client.get(f"{service.rstrip('/')}/api/drives/{quote(name, safe='')}/estimates")
        content = response.json()
    except (httpx.HTTPError, httpx.InvalidURL, ValueError) as error:
        raise BenchError(f"no bench service answers at {service}: {error}") from None
    if response.is_success and isinstance(content, dict) and "estimates" in content:
        return cast(dict[str, Any], content)
    if isinstance(content, dict) and "detail" in content:
        raise BenchError(str(cast(dict[str, Any], content)["detail"]))
    raise BenchError(f"expected a bench service at {service}, got another answer ({response.status_code})")


def _table(content: dict[str, Any]) -> Table:
    settings = content["window"]
    age = "no data yet" if content["age_s"] is None else f"{content['age_s']:.2f} s old"
    title = f"{content['drive']}: {content['status'].replace('_', ' ')}"
    return estimates_table(
        content, settings, f"{basis_of(settings, content['samples'])}, {content['gaps']} gaps, {age}", title
    )
