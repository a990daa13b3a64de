"""The C module, compiled and called from Python: as `window_ls` is, of samples in the estimator's terms."""

import ctypes
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from estimator.arrays import Array
from estimator.export_c.module import Module, sources
from estimator.export_c.vectors import STALE
from estimator.machine import PARAMETERS
from estimator.online.estimate import Status
from estimator.samples import Samples

HERE = Path(__file__).parent
STRICT = (
    "-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Wshadow", "-Werror", "-pedantic", "-O2",
    "-fno-math-errno",
)  # fmt: skip
STATUSES = (Status.OK, Status.DOUBTFUL, Status.STALE, Status.HELD, Status.NOT_TOLD, Status.NO_DATA)


@dataclass(frozen=True, slots=True)
class Said:
    """What the module says of a parameter."""

    value: float
    std: float
    status: Status


@dataclass(frozen=True, slots=True)
class Estimates:
    """What the module says."""

    of: dict[str, Said]
    residual_rms: float  # V
    samples: int
    gaps: int


def written(module: Module, folder: Path) -> Path:
    """The module's sources in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in sources(module).items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder


def as_samples(samples: Samples) -> Array:
    """Samples as the module takes them (n, 6)."""
    angle = samples.theta_e
    return np.column_stack((np.sin(angle), np.cos(angle), samples.i_d, samples.i_q, samples.u_d, samples.u_q))


class CWindow:
    """A window of the C module; `known` in SI."""

    def __init__(
        self, module: Module, known: Mapping[str, float], T_s: float, folder: Path, compiler: str = "gcc",
        stale_after: int = STALE,
    ) -> None:
        real: Any = {"float32": ctypes.c_float, "float64": ctypes.c_double}[module.type]

        class Settings(ctypes.Structure):
            _fields_ = [
                ("T_s", real), ("known", real * 4), ("step_i", real), ("step_u", real), ("step_theta", real),
                ("stale_after", ctypes.c_uint32),
            ]  # fmt: skip

        class Found(ctypes.Structure):
            _fields_ = [
                ("value", real * 4), ("std", real * 4), ("status", ctypes.c_int * 4), ("residual_rms", real),
                ("samples", ctypes.c_uint32), ("gaps", ctypes.c_uint32),
            ]  # fmt: skip

        self._Found, self._type, self.tick = Found, np.dtype(module.type), 0
        where = written(module, folder)
        library = where / f"{compiler}.so"
        files = [where / "pmsm_window.c", where / "pmsm_solve.c", HERE / "harness.c"]
        command = [compiler, *STRICT, "-shared", "-fPIC", f"-I{where}", *map(str, files), "-o", str(library), "-lm"]
        subprocess.run(command, check=True)
        self._library = ctypes.CDLL(str(library))
        self.bytes = ctypes.c_uint32.in_dll(self._library, "size_of_window").value
        self._window = ctypes.create_string_buffer(self.bytes)
        settings = Settings(
            T_s, (real * 4)(*(known.get(name, 0.0) for name in PARAMETERS)), 0.0, 0.0, 0.0, stale_after
        )
        self._library.pmsm_window_init(self._window, ctypes.byref(settings))

    def take(self, samples: Array, *, after: int = 1) -> None:
        """Take in samples (n, 6), the first of them so many ticks after the last one."""
        rows = np.ascontiguousarray(samples, dtype=self._type)
        first = self.tick + after
        self.tick = first + len(rows) - 1
        self._library.take(
            self._window, ctypes.c_uint32(first), ctypes.c_uint32(len(rows)), ctypes.c_void_p(rows.ctypes.data)
        )

    def count_from(self, number: int) -> None:
        """Have the empty window count rows from there."""
        self._library.count_from(self._window, ctypes.c_uint32(number))

    def solve(self, *, later: int = 0) -> Estimates:
        """What the window says, so many ticks after its newest sample."""
        found: Any = self._Found()
        self._library.pmsm_window_solve(self._window, ctypes.c_uint32(self.tick + later), ctypes.byref(found))
        of = {
            name: Said(float(found.value[j]), float(found.std[j]), STATUSES[int(found.status[j])])
            for j, name in enumerate(PARAMETERS)
        }
        return Estimates(of, float(found.residual_rms), int(found.samples), int(found.gaps))
