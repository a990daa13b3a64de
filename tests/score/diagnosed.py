"""Recordings of a suite through the diagnosis, in processes that know the recordings' folder and nothing else."""

import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final, cast

from bench.machine_file import load_machine
from estimator.diagnosis.verdict import Diagnosis
from estimator.machine import Machine
from estimator.samples import Samples
from tests.support.recordings import read_recording

_WARM: Final = 3_000  # rows

Diagnose = Callable[[Sequence[Samples], Machine], Diagnosis]
"""What is scored. Raises ValueError where a recording cannot be diagnosed."""


@dataclass(frozen=True, slots=True)
class Said:
    """What was said of a recording, and in which time."""

    diagnosis: Diagnosis | None
    error: str  # why there is none
    seconds: float  # with the file's reading


def loaded(folder: Path, name: str) -> tuple[list[Samples], Machine]:
    """A recording's runs, with dc link and phase currents, and its nominal machine."""
    nominal = load_machine(folder / f"{name}.toml")
    path = folder / f"{name}.parquet"
    runs = read_recording(path, T_s=nominal.T_s, theta_step=nominal.theta_step, u_dc=nominal.u_dc).runs
    if nominal.machine is None:
        raise ValueError(f"{folder / name}.toml: expected a whole machine")
    return list(runs), nominal.machine


def named(function: str) -> Diagnose:
    """The function "module:name". Raises ImportError, AttributeError."""
    module, _, name = function.partition(":")
    return cast(Diagnose, getattr(import_module(module), name))


def diagnosed(
    wanted: Sequence[tuple[Path, str]], function: str, jobs: int
) -> Iterator[tuple[tuple[Path, str], Said]]:
    """What `function` ("module:name") says of recordings (folder and name), in the order in which they are done."""
    started = (function, *wanted[0])
    with ProcessPoolExecutor(jobs, get_context("spawn"), _warm_up, started) as pool:
        futures = {pool.submit(said_of, function, *each): each for each in wanted}
        for future in as_completed(futures):
            yield futures[future], future.result()


def _warm_up(function: str, folder: Path, name: str) -> None:
    """Compile, so that no recording's time has it in it: by the first rows of one."""
    said_of(function, folder, name, _WARM)


def said_of(function: str, folder: Path, name: str, most: int | None = None) -> Said:
    """What is said of a recording, or of so many of its first rows."""
    diagnose, begun = named(function), time.perf_counter()
    try:
        runs, machine = loaded(folder, name)
        if most is not None:
            runs = [run[:most] for run in runs[: 1 + most // len(runs[0])]]
        found = diagnose(runs, machine)
    except ValueError as error:
        return Said(None, str(error), time.perf_counter() - begun)
    except Exception:  # noqa: BLE001 - a defect costs its recording, not the whole score
        return Said(None, traceback.format_exc(), time.perf_counter() - begun)
    taken = time.perf_counter() - begun
    return Said(replace(found, **_plain(found)), "", taken)


def _plain(found: Diagnosis) -> Mapping[str, Any]:
    """Without what is for pictures."""
    return {"traces": None, "detectable": dict(found.detectable)}
