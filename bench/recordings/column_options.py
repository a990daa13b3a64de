"""Options whose value is several, as `NAME=VALUE,...`: what a recording's columns are."""

from collections.abc import Callable, Sequence
from typing import TypeVar

from bench.errors import ConfigError

T = TypeVar("T")


def pairs(option: str, items: Sequence[str], convert: Callable[[str], T]) -> dict[str, T]:
    """NAME=VALUE,... of a repeatable option."""
    found: dict[str, T] = {}
    for item in ",".join(items).split(","):
        if not item:
            continue
        name, equals, value = (part.strip() for part in item.partition("="))
        try:
            if not (name and equals and value):
                raise ValueError
            converted = convert(value)
        except ValueError:
            form = "NAME=COLUMN" if convert is str else "NAME=NUMBER"
            raise ConfigError(f"{option}: expected {form}[,...], got {item!r}") from None
        if name in found:
            raise ConfigError(f"{option}: {name} is given twice")
        found[name] = converted
    return found


def columns_of(
    mapping: Sequence[str] | None, constants: Sequence[str] | None, align: Sequence[str] | None, mark: str = "--"
) -> tuple[dict[str, str], dict[str, float], dict[str, float]]:
    """What `--map`, `--set` and `--align` say of a recording's columns. Raises ConfigError.

    `mark`: before the options' names, as a sentence shows them.
    """
    return (
        pairs(f"{mark}map", mapping or (), str), pairs(f"{mark}set", constants or (), float),
        pairs(f"{mark}align", align or (), float),
    )  # fmt: skip
