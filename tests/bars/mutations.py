"""Files that lie: copies of good files, each with something changed, and what the bench makes of them.

`python -m tests.bars.mutations --count 1000` prints a table: how many copies of each kind are refused in a sentence,
told with a word, or read to the same values, and how many end in a traceback, take over 10 s, or lie - a value told
`ok` that is over three of its standard errors from that of the undamaged file, without a word. Seeds are fixed.
"""

import argparse
import contextlib
import csv
import io
import json
import random
import resource
import signal
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from types import FrameType
from typing import Any, Final

import numpy as np

from bench.actions.capture_request import NEEDED, Request
from bench.cli.commands.experiment import asked_of
from bench.diagnoses.diagnose import as_json, diagnose_recording
from bench.diagnoses.diagnosis_request import Request as Asked
from bench.diagnoses.simulate import simulate
from bench.errors import BenchError
from bench.live.window import Window
from bench.machine_file import Nominal, load_machine
from bench.recordings.capture_file import CapturePart, Heading, write_columns
from bench.recordings.recording import open_recording
from bench.recordings.replay import replay
from emulator.bounds import ScenarioError
from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.scenarios import PAPER, load
from emulator.scenario.text import text_of
from tests.proof.results import record
from tests.support.recordings import read_recording

ROWS: Final = 3000  # of the recording
MEMORY: Final = 1.5  # GB
LONGEST: Final = 10.0  # s that a file may take
_WAITED: Final = 60.0  # s, on a machine that does much else
FAR: Final = 3.0  # standard errors
REFUSED, TOLD, SAME, LIES, FAILED, HANGS = "refused", "told", "same", "LIES", "TRACEBACK", "HANGS"
OUTCOMES: Final = (REFUSED, TOLD, SAME, LIES, FAILED, HANGS)
MACHINE: Final = """# Nominal values
[machine]
R_s = 0.95
L_d = 4.1e-3
L_q = 6.3e-3
psi_f = 0.118
n_p = 4
i_rated = 6.0

[drive]
T_s = 1e-4
u_dc = 310.0
encoder_counts = 65536
angle_ahead = 0.0

[effects.inverter_voltage_error]
V_error = 1.5
"""
DIAGNOSIS: Final[dict[str, Any]] = {
    "verdict": "ambiguous", "sentence": "two effects",
    "machine": {"nominal": {"R_s": 0.97, "L_d": 4.2e-3, "L_q": 6.3e-3, "psi_f": 0.118, "n_p": 4, "i_rated": 6.0}},
    "ambiguous": [{"effects": ["a", "b"], "reason": "alike", "experiment": {
        "sentence": "hold a level", "step": 0.3,
        "holds": [{"speed_rpm": 1200.0, "i_d": -1.0, "i_q": 2.0, "seconds": 0.5}],
    }}],
    "experiment": None,
}  # fmt: skip
MOTEUS: Final[dict[str, Any]] = {
    "params": {"R": 0.05, "poles": 14, "v_per_hz": 0.2, "cal_inductance_d_H": 2e-5},
    "raw": {str(i_d): [{"omega": w, "y": w * (4.5e-3 + 2e-5 * i_d) + 0.01 * np.sin(w)} for w in (200.0, 400.0, 600.0)]
            for i_d in (-20.0, -10.0, 0.0, 10.0)},
}  # fmt: skip
NASTY: Final = (
    "nan", "-nan", "inf", "-inf", "0", "-1", "1e308", "-1e308", "1e-308", "9" * 400, "-" + "9" * 400, "9" * 5000,
    "true", '""', '"x"', "[]", "{}", "[[1]]", "[" * 5000, "{a=" * 2000, "null", "1979-05-27", "0x7fffffffffffffff",
    "1e", ",", '"\\u001b[31m"', '"[/red]"', "\x00", "\x1b[2J", "\ufeff", "\ud7ff",
)  # fmt: skip
CELLS: Final = (
    "", "nan", "inf", "-inf", "1e300", "-1e300", "1e11", "-32768", "65535", "999999", "0", "x", "1,5", "1e400", "-",
    "NULL",
)


class TooLongError(Exception):
    """It has taken longer than it may."""


@dataclass
class Found:
    """What became of the copies of one kind."""

    outcomes: Counter[str] = field(default_factory=Counter[str])
    slowest: float = 0.0  # s
    worst: list[str] = field(default_factory=list[str])  # of what is not to be, a line each


Judge = Callable[[random.Random, Path], str]
"""Changes something in a copy that it makes in a folder, has it read, and tells the outcome."""


def run(kind: str, count: int, folder: Path) -> Found:
    """So many copies of a kind."""
    chance, found, judge = random.Random(f"{kind} 1"), Found(), KINDS[kind](folder)
    for number in range(count):
        begun = time.process_time()
        try:
            with _limited(), contextlib.redirect_stdout(io.StringIO()):
                outcome = judge(chance, folder)
        except (BenchError, ScenarioError) as error:
            outcome = REFUSED if str(error).strip() else FAILED
        except TooLongError:
            outcome = HANGS
        except Exception as error:  # noqa: BLE001 - this is what is looked for
            outcome = FAILED
            found.worst.append(f"{kind} {number}: {type(error).__name__}: {str(error)[:200]}")
        found.slowest = max(found.slowest, time.process_time() - begun)
        found.outcomes[outcome] += 1
        if outcome in (LIES, HANGS):
            found.worst.append(f"{kind} {number}: {outcome}")
    return found


@contextlib.contextmanager
def _limited() -> Generator[None]:
    """Raises TooLongError in what takes too long."""

    def too_long(_number: int, _frame: FrameType | None) -> None:
        raise TooLongError

    before = [(number, signal.signal(number, too_long)) for number in (signal.SIGALRM, signal.SIGPROF)]
    signal.setitimer(signal.ITIMER_PROF, LONGEST)  # of this process, whatever else the machine does
    signal.setitimer(signal.ITIMER_REAL, _WAITED)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in before:
            signal.signal(number, handler)


# --- What is changed


def one_bit(chance: random.Random, content: bytes) -> bytes:
    """One bit is another."""
    bit, changed = chance.randrange(8 * len(content)), bytearray(content)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)


def tail(chance: random.Random, content: bytes) -> bytes:
    """What a power cut or a bad disk does to a file that grows."""
    at = len(content) - chance.randrange(1, min(len(content), 16_384))
    rest = len(content) - at
    block = content[at - rest : at] if at >= rest else bytes(rest)
    return chance.choice((
        content[:at], content[:at] + bytes(rest), content[:at] + chance.randbytes(rest), content[:at] + block,
        content + bytes(rest), content + content[at:], one_bit(chance, content),
    ))  # fmt: skip


def text(chance: random.Random, content: str) -> bytes:
    """A text with a character, a value, a line or a stretch changed."""
    lines = content.splitlines(keepends=True)
    line = chance.randrange(len(lines))
    match chance.randrange(6):
        case 0:
            return one_bit(chance, content.encode())
        case 1 | 2:  # a value
            key, mark, _ = lines[line].partition(":" if '": ' in lines[line] else "=")
            lines[line] = f"{key}{mark} {chance.choice(NASTY)}\n" if mark else lines[line]
        case 3:
            lines.insert(line, chance.choice(lines))
        case 4:
            del lines[line]
        case _:
            at = chance.randrange(len(content))
            return (content[:at] + chance.choice(NASTY) + content[at + chance.randrange(3) :]).encode(
                "utf-8", errors="surrogatepass"
            )
    return "".join(lines).encode("utf-8", errors="surrogatepass")


# --- The good files


@cache
def recorded() -> Mapping[str, Any]:
    """A recording of the emulated drive, by column."""
    return VirtualDrive(PAPER).record(ROWS)


def _csv(folder: Path, cells: list[list[str]]) -> Path:
    path = folder / "copy.csv"
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(cells)
    return path


@cache
def _cells() -> list[list[str]]:
    columns = {name: column for name, column in recorded().items() if name in ("t", "u_dc", *NEEDED)}
    rows = zip(*(map(repr, np.asarray(column).tolist()) for column in columns.values()), strict=True)
    return [list(columns), *map(list, rows)]


# --- The kinds


def capture_bits(folder: Path) -> Judge:
    """A capture's recording, one bit changed."""
    columns = {name: recorded()[name] for name in ("t", *NEEDED)}
    said = {"decimation": 1, "expected": ROWS, "steps": {"i_d": 1e-3, "i_q": 1e-3}}
    path = write_columns(folder / "good.parquet", columns, said)
    whole, good = path.read_bytes(), _values(path)

    def judge(chance: random.Random, folder: Path) -> str:
        copy = folder / "copy.parquet"
        copy.write_bytes(one_bit(chance, whole))
        return SAME if _values(copy) == good else LIES

    return judge


def _values(path: Path) -> tuple[object, ...]:
    """All that a recording tells."""
    recording = read_recording(path)
    names = ("t0", "theta_e", "omega_e", "i_d", "i_q", "u_d", "u_q")
    columns = [np.asarray(getattr(run, name)).tobytes() for run in recording.runs for name in names]
    return (*columns, recording.runs[0].resolution, recording.summary.remarks())


def part_tails(folder: Path) -> Judge:
    """A capture under way, its end changed: what is read of it is what was written, as far as it goes."""
    size = 2 * len(NEEDED)
    data = random.Random(1).randbytes(8192 * size)
    asked = "2026-01-31T12:00:00+00:00"
    heading = Heading("a-1", "a", "canopen://virtual/x/5", "x", asked, Request(NEEDED, 8192).as_json(), 1e-4, {})
    part = CapturePart.begun(folder / "good.part", heading)
    part.change(replace(heading, number=1, count=8192))
    for end in range(127 * size, len(data) + 1, 127 * size):
        part.keep(bytearray(data), end)
    part.close()
    good, headings = part.path.read_bytes(), (heading, part.heading)

    def judge(chance: random.Random, folder: Path) -> str:
        copy = folder / "copy.part"
        copy.write_bytes(tail(chance, good))
        read = CapturePart.found(copy)
        assert read is not None
        read.close()
        if read.heading not in headings or not data.startswith(read.data) or len(read.data) % size:
            return LIES
        return SAME if len(read.data) >= len(data) - len(data) % (127 * size) else TOLD  # the rest is taken again

    return judge


def replayed_cells(_folder: Path) -> Judge:
    """A recording in CSV, one cell changed, replayed."""
    good = _replayed(_csv(_folder, _cells()))

    def judge(chance: random.Random, folder: Path) -> str:
        return _compared(good, _replayed(_csv(folder, _spoiled(chance))))

    return judge


def diagnosed_cells(_folder: Path) -> Judge:
    """A recording in CSV, one cell changed, diagnosed."""
    good = _diagnosed(_csv(_folder, _cells()))

    def judge(chance: random.Random, folder: Path) -> str:
        return _compared(good, _diagnosed(_csv(folder, _spoiled(chance))))

    return judge


@dataclass(frozen=True)
class Said:
    """What is said of a recording."""

    values: Mapping[str, tuple[float, float]]  # value and standard error of what is `ok`
    words: tuple[str, ...]


def _replayed(path: Path) -> Said:
    with open_recording(path, optional=False) as reader:
        done = replay(reader, Window(length=ROWS))
    estimates = done.result.estimates.items()
    values = {name: (e.value, e.std) for name, e in estimates if e.status == "ok" and e.value is not None and e.std}
    return Said(values, done.remarks)


def _diagnosed(path: Path) -> Said:
    known = {"R_s": 0.95, "L_d": 4.1e-3, "L_q": 6.3e-3, "psi_f": 0.118}
    nominal = Nominal(known, n_p=4, i_rated=6.0, T_s=1e-4, u_dc=310.0)
    said = as_json(diagnose_recording(Asked(path, nominal), lambda share, phase: None))
    after = said["machine"]["after"].items() if said["verdict"] in ("no_mismatch", "explained") else ()
    values = {name: (one["value"], one["std"]) for name, one in after if one["value"] is not None and one["std"]}
    return Said(values, (said["verdict"], *said["remarks"]))


def _compared(good: Said, copy: Said) -> str:
    far = any(
        abs(value - good.values[name][0]) > FAR * good.values[name][1]
        for name, (value, _) in copy.values.items() if name in good.values
    )
    if set(copy.words) - set(good.words) or set(copy.values) != set(good.values):
        return TOLD
    return LIES if far else SAME


def _spoiled(chance: random.Random) -> list[list[str]]:
    """The recording with one cell changed."""
    cells = list(_cells())
    row, column = chance.randrange(1, len(cells)), chance.randrange(len(cells[0]))
    cells[row] = list(cells[row])
    cell = cells[row][column]
    other = chance.randrange(6)
    cells[row][column] = (
        chance.choice(CELLS), cell.replace(".", ""), f"-{cell}", f"{cell}e2", cells[row - 1][column - 1],
        cell[: chance.randrange(len(cell) + 1)],
    )[other]  # fmt: skip
    return cells


def machine_files(folder: Path) -> Judge:
    """A machine file, for a replay with its values held and a simulation with its effects."""
    recording = _csv(folder, _cells()[:301]).rename(folder / "recording.csv")

    def judge(chance: random.Random, folder: Path) -> str:
        copy = folder / "copy.toml"
        copy.write_bytes(text(chance, MACHINE))
        nominal = load_machine(copy)
        with open_recording(recording, T_s=nominal.T_s, theta_step=nominal.theta_step, optional=False) as reader:
            replay(reader, Window(length=200, held=nominal.given))
        with contextlib.suppress(BenchError):  # without an equation
            simulate(Asked(recording, nominal))
        return SAME if nominal.told == load_machine(_machine(folder)).told else TOLD

    return judge


def _machine(folder: Path) -> Path:
    path = folder / "good.toml"
    path.write_text(MACHINE, encoding="utf-8")
    return path


def scenario_files(_folder: Path) -> Judge:
    """A scenario, whose drive is made, and runs for some periods where it is plausible."""
    content = text_of(PAPER)

    def judge(chance: random.Random, folder: Path) -> str:
        copy = folder / "scenario.toml"
        copy.write_bytes(text(chance, content))
        scenario = load(copy)
        drive = VirtualDrive(scenario)
        rows = drive.record(20)
        if not all(np.isfinite(column).all() for column in rows.values()):
            return LIES
        return TOLD

    return judge


def diagnosis_files(_folder: Path) -> Judge:
    """A diagnosis in JSON, of which an experiment is asked."""
    content = json.dumps(DIAGNOSIS, indent=1)

    def judge(chance: random.Random, folder: Path) -> str:
        copy = folder / "copy.json"
        copy.write_bytes(text(chance, content))
        asked_of(copy, None)
        return TOLD

    return judge


def calibration_files(folder: Path) -> Judge:
    """A calibration of L_d in JSON, diagnosed."""
    content = json.dumps(MOTEUS, indent=1)
    good = folder / "good.json"
    good.write_text(content, encoding="utf-8")
    diagnose_recording(Asked(good, Nominal({}), format="auto"), lambda share, phase: None)

    def judge(chance: random.Random, folder: Path) -> str:
        copy = folder / "copy.json"
        copy.write_bytes(text(chance, content))
        diagnose_recording(Asked(copy, Nominal({}), format="auto"), lambda share, phase: None)
        return TOLD

    return judge


KINDS: Final[Mapping[str, Callable[[Path], Judge]]] = {
    "capture bits": capture_bits, "part tails": part_tails, "cells, replayed": replayed_cells,
    "cells, diagnosed": diagnosed_cells, "machine files": machine_files, "scenario files": scenario_files,
    "diagnosis JSON": diagnosis_files, "calibration JSON": calibration_files,
}  # fmt: skip


def main() -> None:
    """All kinds, or those that are named, as a table."""
    parser = argparse.ArgumentParser("python -m tests.bars.mutations", description=__doc__)
    parser.add_argument("--count", type=int, default=1000, metavar="N", help="copies of each kind (1000)")
    parser.add_argument("--kind", action="append", choices=KINDS, help="one kind alone; may be repeated")
    options = parser.parse_args()
    print(f"{'':18}" + "".join(f"{outcome:>11}" for outcome in OUTCOMES) + f"{'slowest, s':>12}{'MB':>7}")
    worst, every, slowest, memory = list[str](), Counter[str](), 0.0, 0.0
    for kind in options.kind or KINDS:
        with tempfile.TemporaryDirectory() as folder:
            found = run(kind, options.count, Path(folder))
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        told = "".join(f"{found.outcomes[outcome]:11}" for outcome in OUTCOMES)
        print(f"{kind:18}{told}{found.slowest:12.2f}{memory:7.0f}", flush=True)
        worst += found.worst
        every.update(found.outcomes)
        slowest = max(slowest, found.slowest)
    print("\n".join(worst[:40]))
    if options.kind is None:
        counts = f"{every[LIES]} of {every.total():,}; {every[FAILED]}; {every[HANGS]}"
        figure = f"{counts}, the slowest took {slowest:.1f} s; {memory / 1024:.2f} GB"
        record("service.mutations", figure, memory <= MEMORY * 1024)


if __name__ == "__main__":
    main()
