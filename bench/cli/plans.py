"""Plans at a terminal: what a flash would change, and whether it is to."""

import sys
from typing import Final

from rich.table import Table

from bench.cli.terminal import Terminal
from bench.errors import ConfigError, ConflictError
from bench.parameters.plan import Plan
from drivers.wire.dictionary import Signal, WireType

_SHOWN: Final = 12  # entries of tables
_WIDE: Final = 110  # characters


def check_asked() -> None:
    """Raise ConfigError where nobody can be asked."""
    if not sys.stdin.isatty():
        raise ConfigError("expected --yes, as nobody can be asked here")


def ask_to_flash() -> None:
    """Raises ConflictError where it is not to be, ConfigError where nobody can be asked."""
    check_asked()
    if input("Flash it? The drive is reset. [y/N] ").strip().lower() not in ("y", "yes"):
        raise ConflictError("not flashed")


def show_plan(to_do: Plan) -> None:
    """Print it; the bits that travel where there is room for them."""
    terminal = Terminal()
    bits = terminal.width >= _WIDE
    table = Table(title=f"{len(to_do.changes)} values change, {to_do.same} stay")
    for heading in ("", "now", "then", "unit", "rounded by", *(("bits now", "bits then") if bits else ())):
        table.add_column(heading, justify="left" if heading in ("", "unit") else "right", no_wrap=True)
    entries = [change for change in to_do.changes if change.signal.table]
    for change in (*(one for one in to_do.changes if not one.signal.table), *entries[:_SHOWN]):
        signal, off = change.signal, f"{change.rounding:.1g}" if change.rounding else ""
        cells = number_of(signal, change.old), number_of(signal, change.new), unit_of(signal), off
        table.add_row(signal.name, *cells, *(change.counts if bits else ()))
    terminal.print(table if to_do.changes else f"nothing changes: {to_do.same} values are as the drive has them")
    if len(entries) > _SHOWN:
        terminal.print(f"and {len(entries) - _SHOWN} more entries of tables")
    for word, lines in (("forbidden", to_do.problems), ("doubtful", to_do.doubts), ("remark", to_do.remarks)):
        for line in lines:
            terminal.print(f"{word}: {line}")


def number_of(signal: Signal, value: float) -> str:
    """As many digits as it travels with."""
    return f"{value:.9g}" if signal.type is WireType.F32 else f"{int(value)}"


def unit_of(signal: Signal) -> str:
    """Empty where it has none."""
    return "" if signal.unit == "1" else signal.unit
