"""A drive's signals in the terminal, over the service's REST interface."""

import math
from collections.abc import Sequence
from typing import Any, cast

from rich.table import Table

from bench.cli.output import print_json
from bench.cli.rest import Rest, rest_at
from bench.cli.terminal import Terminal, plain
from bench.errors import ConfigError, shown

_TIMEOUT = 30.0  # s; a slow line takes long for all of them


def show(name: str, given: list[str], service: str | None, *, as_json: bool) -> None:
    """Write what is given as SIGNAL=VALUE, read what is given as SIGNAL, and print. Raises BenchError."""
    values = pairs_of([text for text in given if "=" in text])
    asked = [text for text in given if "=" not in text]
    with rest_at(service, _TIMEOUT) as rest:
        told: list[dict[str, Any]] = []
        if values:
            told += rest.call("PUT", name, "signals", body=values, key="signals")["signals"]
        if asked or not values:
            told += read_from(rest, name, asked)
    if as_json:
        print_json({"drive": name, "signals": told})
    else:
        Terminal().print(_table(name, told))


def read_from(rest: Rest, name: str, asked: Sequence[str]) -> list[dict[str, Any]]:
    """Signals by name, all where none is named, as the service tells them. Raises BenchError."""
    content = rest.call("GET", name, "signals", key="signals", query={"names": ",".join(asked)})
    return cast(list[dict[str, Any]], content["signals"])


def pairs_of(given: list[str]) -> dict[str, float]:
    """Values given as SIGNAL=NUMBER. Raises ConfigError."""
    found: dict[str, float] = {}
    for text in given:
        name, _, value = map(str.strip, text.partition("="))
        try:
            found[name] = float(value)
        except ValueError:
            raise ConfigError(f"expected SIGNAL=NUMBER, got {shown(text)}") from None
        if not math.isfinite(found[name]):
            raise ConfigError(f"{shown(name)}: expected a finite number, got {value}")
    return found


def _table(name: str, signals: list[dict[str, Any]]) -> Table:
    table = Table("signal", "value", "unit", "", "what", title=name)
    for signal in signals:
        value = "not known" if signal["value"] is None else plain(float(signal["value"]))
        table.add_row(signal["name"], value, signal["unit"], signal["access"], signal["summary"])
    return table
