"""The drive's Modbus register map as a table, or as JSON."""

import sys
from typing import Any

from rich.table import Table

from bench.cli.output import print_json
from bench.cli.terminal import Terminal
from drivers.wire.modbus_map import table


def show(*, as_json: bool) -> None:
    """Print the map to standard output."""
    if as_json:
        print_json(table())
        return
    shown = Table(
        title="holding registers", caption="addresses count from 0; 32-bit values: the high word first; the register "
        "after a 16-bit signal reads 0",
    )
    for heading in ("address", "hex", "registers", "name", "type", "one count", "access", "what"):
        right = heading in ("address", "registers")
        shown.add_column(heading, justify="right" if right else "left", no_wrap=heading != "what")
    for line in table():
        shown.add_row(
            str(line["address"]), f"0x{line['address']:04X}", str(line["registers"]), line["name"], line["type"],
            _count(line), line["access"], line["summary"],
        )
    Terminal(width=None if sys.stdout.isatty() else 160).print(shown)


def _count(line: dict[str, Any]) -> str:
    """What one count is; of a float or a text, its unit."""
    if line["scale"] is None:
        return line["unit"] if line["unit"] != "1" else ""
    if line["full_scale"]:
        return f"{line['full_scale']} / {1.0 / line['scale']:g}"
    return "" if (line["scale"], line["unit"]) == (1.0, "1") else f"{line['scale']:.6g} {line['unit']}"
