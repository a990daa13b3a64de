"""Files of a suite: recordings as the bench writes them, nominal machines as a user has them, answers elsewhere.

Every recording's file is as long as any other of as many rows - no compression, no dictionary - and all have the same
date, so that neither tells what is in them.
"""

import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, get_args, get_type_hints

from drivers.wire.codec import channel_signal, count_size
from emulator.bounds import Bound
from emulator.conceal.populations import POPULATIONS
from emulator.conceal.recording import Choice, Concealed, full_scales, recorded
from emulator.drive.virtual_drive import Column
from emulator.plant.machine import Machine
from emulator.scenario.effects import NONE
from emulator.scenario.motors import MOTORS, TOLERANCE
from emulator.scenario.scenarios import Scenario, parse
from emulator.scenario.text import keys_of, section_text, text_of

_NOTES: Final = b"pmsm-bench"  # key of the bench's notes in a Parquet file
_DATE: Final = 1_700_000_000.0  # Unix time of all files
_MACHINE_KEYS: Final = ("R_s", "L_d", "L_q", "psi_f", "n_p", "i_rated")
MANIFEST: Final = "manifest.json"


def write(
    concealed: Concealed, columns: Mapping[str, Column], choice: Choice, name: str, out: Path, answers: Path
) -> None:
    """Write the recording and its nominal machine into one folder, its answer into another. Raises OSError."""
    answer = json.dumps(answer_of(concealed, choice, name), indent=2, ensure_ascii=False) + "\n"
    _whole(answers / f"{name}.json", lambda path: path.write_text(answer, encoding="utf-8"))
    machine = nominal_text(concealed)
    _whole(out / f"{name}.toml", lambda path: path.write_text(machine, encoding="utf-8"))
    _whole(out / f"{name}.parquet", lambda path: write_recording(path, concealed.scenario, columns))


def date_alike(folder: Path, name: str) -> None:
    """Give a recording's files the date that all have."""
    for path in (folder / f"{name}.parquet", folder / f"{name}.toml"):
        os.utime(path, (_DATE, _DATE))


def nominal_text(concealed: Concealed) -> str:
    """The machine file of a user who has the data sheet and the drive's nameplate."""
    motor, drive = MOTORS[concealed.drawn.motor], concealed.scenario.drive
    units = _units(Machine)
    nominal = motor.machine._asdict()
    machine = section_text(
        "machine",
        {key: nominal[key] for key in _MACHINE_KEYS},
        {key: units[key] for key in _MACHINE_KEYS if units[key] != "1"},
    )
    counts = {"encoder_counts": drive.encoder_counts} if drive.encoder_counts else {}
    plate = section_text(
        "drive",
        {"T_s": drive.T_s, "u_dc": motor.u_dc, **counts},
        {"T_s": "s", "u_dc": "V", "encoder_counts": "of a mechanical turn"},
    )
    return f"# {motor.title}; R_s, L_d, L_q, psi_f within {TOLERANCE:.0%}\n{machine}\n{plate}"


def answer_of(concealed: Concealed, choice: Choice, name: str) -> dict[str, Any]:
    """All that a recording conceals, and what makes it anew."""
    scenario, drawn = concealed.scenario, concealed.drawn
    there = {
        section: _with_units(sizes)
        for section, sizes in scenario.effects._asdict().items()
        if sizes != getattr(NONE, section)
    }
    return {
        "recording": name,
        "kind": concealed.kind,
        "classes": list(concealed.classes),
        "sizes": {
            key: {
                "value": value, "unit": POPULATIONS[key].unit, "of": POPULATIONS[key].size,
                "range": [POPULATIONS[key].low, POPULATIONS[key].high],
            }
            for key, value in concealed.sizes.items()
        },
        "effects": there,
        "surroundings": {section: sorted(keys) for section, keys in drawn.surroundings.items()},
        "motor": drawn.motor,
        "machine": _with_units(scenario.motor),
        "nominal": _with_units(MOTORS[drawn.motor].machine),
        "seed": choice.seed,
        "number": concealed.number,
        "redrawn": concealed.redrawn,
        "periods": concealed.periods,
        "scenario": text_of(scenario),
    }  # fmt: skip


def made_anew(answer: Mapping[str, Any]) -> dict[str, Column]:
    """The recording's columns, number for number, from its answer."""
    return recorded(parse(answer["scenario"], f"recording {answer['recording']}"), answer["periods"])


def write_recording(path: Path, scenario: Scenario, columns: Mapping[str, Column]) -> None:
    """Write a recording as the bench writes it. Raises OSError."""
    import pyarrow
    import pyarrow.parquet

    pa: Any = pyarrow  # comes without types
    pq: Any = pyarrow.parquet
    full = full_scales(scenario)
    notes = {
        "samples": len(columns["t"]), "T_s": scenario.drive.T_s, "decimation": 1, "tick": 0,
        "steps": {name: count_size(channel_signal(name), full) for name in columns if name != "t"},
    }  # fmt: skip
    schema = pa.schema(
        [pa.field(name, pa.float64(), metadata={"unit": _unit(name)}) for name in columns],
        metadata={_NOTES: json.dumps(notes).encode()},
    )
    pq.write_table(
        pa.table(dict(columns), schema=schema), path, compression="none", use_dictionary=False, write_statistics=False
    )


def _unit(column: str) -> str:
    return "s" if column == "t" else channel_signal(column).unit


def _whole(path: Path, fill: Callable[[Path], object]) -> None:
    """Write a file whole or not at all."""
    unfinished = path.with_name(f".{path.name}.unfinished")
    try:
        fill(unfinished)
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


def _with_units(record: Any) -> dict[str, Any]:
    units = _units(record.__class__)
    return {key: {"value": value, "unit": units[key]} for key, value in keys_of(record).items()}


def _units(kind: type) -> dict[str, str]:
    """Unit of each number of a named tuple; what has none is 1, a text empty."""
    hints = get_type_hints(kind, include_extras=True)
    bounds = {name: [part for part in get_args(hint)[1:] if isinstance(part, Bound)] for name, hint in hints.items()}
    return {name: found[0].unit if found else "" for name, found in bounds.items()}
