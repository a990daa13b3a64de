"""A scenario as the TOML text that `scenarios.parse` reads back to the same scenario, number for number."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, cast

from emulator.scenario.effects import NONE
from emulator.scenario.scenarios import Scenario


def text_of(scenario: Scenario) -> str:
    """All sections, of settings and effects those that there are."""
    sections = {
        field.name: keys_of(getattr(scenario, field.name))
        for field in fields(scenario)
        if field.name not in ("name", "effects", "settings")
    }
    if scenario.settings:
        sections["settings"] = dict(scenario.settings)
    for name, sizes in scenario.effects._asdict().items():
        if sizes != getattr(NONE, name):
            sections[f"effects.{name}"] = keys_of(sizes)
    return "\n".join(section_text(name, keys) for name, keys in sections.items())


def section_text(name: str, keys: Mapping[str, object], comments: Mapping[str, str] | None = None) -> str:
    """One section, with comments to some of its keys."""
    told = comments or {}
    lines = [f"{key} = {_value(value)}" + (f"  # {told[key]}" if key in told else "") for key, value in keys.items()]
    return "\n".join([f"[{name}]", *lines, ""])


def keys_of(record: Any) -> dict[str, object]:
    """Fields of a dataclass or named tuple."""
    if is_dataclass(record):
        return {field.name: getattr(record, field.name) for field in fields(record)}
    return cast(dict[str, object], record._asdict())


def _value(value: object) -> str:
    if isinstance(value, str | bool):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(_value, cast(Sequence[object], value)))}]"
    return repr(value)
