"""The C module beside Python and beside the published window: `python -m tests.bars.bench_export_c`.

Float32 against the float64 estimate of Python over ten million samples of emulated drives; whether the difference grows
with time; instructions a sample on a Cortex-M4F (its code in qemu-arm, an instruction at a time) and on this machine
(valgrind); bytes. Beside it the published up- and downdate in float32 on the same rows, against the exact least squares
of its window, where it is given the rows ready made. Needs gcc; what else is missing is said. `--samples N` for another
number; with less than a million, chance decides on drift. Ends with 1 where a bar is missed.
"""

import argparse
import ctypes
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np

from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.scenarios import PAPER, PAPER_RUN, Scenario
from estimator.arrays import Array
from estimator.export_c.module import Module
from estimator.export_c.vectors import statuses
from estimator.machine import PARAMETERS
from estimator.online import window_ls
from estimator.online.flux_balance import flux_balance
from estimator.samples import Samples
from tests.estimator.export_c.c_window import HERE, CWindow, as_samples, written
from tests.proof.results import record
from tests.support.samples import recorded

THREE: Final = ("R_s", "L_d", "L_q")
WINDOW: Final = 400
BARS: Final = {"relative": 1e-4, "drift": 1.3, "instructions": 400, "bytes": 16_000}
BLOCK: Final = 50_000  # samples at once
EVERY: Final = 1009  # samples between two comparisons
OFF: Final = 1.1  # times its value is what is known of a parameter that is estimated
CORTEX: Final = ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16")
OPTIMISED: Final = ("-std=c99", "-O2", "-fno-math-errno")


def drives() -> dict[str, tuple[Scenario, float]]:
    """What runs, and its share of the samples."""
    swinging = replace(PAPER, run=replace(PAPER.run, swing_rpm=200.0, swing_frequency=3.0))
    backwards = replace(PAPER, run=replace(PAPER.run, speed_rpm=-1200.0))
    slow = replace(PAPER, run=replace(PAPER.run, speed_rpm=150.0))
    return {
        "1200 rpm": (PAPER, 0.6), "swinging, 1200 +- 200 rpm": (swinging, 0.1), "backwards": (backwards, 0.1),
        "150 rpm": (slow, 0.1), "speed control, switched bridge": (PAPER_RUN, 0.1),
    }  # fmt: skip


def blocks(scenario: Scenario, samples: int) -> Iterator[tuple[VirtualDrive, Samples]]:
    """A drive's samples, block by block."""
    drive = VirtualDrive(scenario)
    for first in range(0, samples, BLOCK):
        yield drive, recorded(drive, min(BLOCK, samples - first))


def known_values(scenario: Scenario) -> dict[str, float]:
    """What is known of the drive's motor: psi_f, and the others not quite."""
    return {name: getattr(scenario.motor, name) * (OFF if name in THREE else 1.0) for name in PARAMETERS}


@dataclass
class Difference:
    """Of C from Python."""

    of_value: list[dict[str, float]] = field(default_factory=list[dict[str, float]])  # by comparison, relative
    of_std: float = 0.0  # largest, relative
    statuses: int = 0  # that differ,
    compared: int = 0  # of so many

    def worst(self, name: str) -> float:
        """Largest of all."""
        return max((each.get(name, 0.0) for each in self.of_value), default=0.0)

    def mean(self, name: str, first: float, last: float) -> float:
        """Root mean square of a part of the comparisons."""
        n = len(self.of_value)
        part = [each[name] for each in self.of_value[int(first * n) : int(last * n)] if name in each]
        return float(np.sqrt(np.mean(np.square(part)))) if part else 0.0


def compared(scenario: Scenario, samples: int, folder: Path) -> tuple[Difference, CWindow]:
    """Both over one drive."""
    known, found = known_values(scenario), Difference()
    c = CWindow(Module(WINDOW, THREE, "float32"), known, scenario.drive.T_s, folder)
    python = window_ls.init(WINDOW)
    for _, block in blocks(scenario, samples):
        rows = as_samples(block)
        for first in range(0, len(block), EVERY):
            last = min(first + EVERY, len(block))
            window_ls.update(python, block[first:last])
            c.take(rows[first:last])
            said, its = window_ls.estimate(python, THREE, known), c.solve().of
            off = dict[str, float]()
            for name, status in statuses(said).items():
                found.compared += 1
                found.statuses += its[name].status is not status
                e = said.estimates[name]
                if its[name].status is status and e.value is not None and e.std is not None:
                    off[name] = abs(its[name].value / e.value - 1.0)
                    found.of_std = max(found.of_std, abs(its[name].std / e.std - 1.0))
            found.of_value.append(off)
    return found, c


class Published:
    """The published window in C, of scaled columns."""

    def __init__(self, folder: Path, type_: str, scale: Array, P_0: float) -> None:
        real = {"float32": "float", "float64": "double"}[type_]
        library = folder / f"published_{real}.so"
        files = [str(HERE / "published.c"), "-o", str(library)]
        subprocess.run(["gcc", *OPTIMISED, "-shared", "-fPIC", f"-DREAL={real}", *files], check=True)
        self._library, self._type, self._scale = ctypes.CDLL(str(library)), np.dtype(type_), scale
        self.bytes = ctypes.c_uint32.in_dll(self._library, "size_of_published").value
        self._state = ctypes.create_string_buffer(self.bytes)
        start = ctypes.c_float(P_0) if type_ == "float32" else ctypes.c_double(P_0)
        self._library.published_init(self._state, start)

    def take(self, rows: Array) -> Array:
        """Rows (n, 2, 4) in; the solution."""
        rows = np.ascontiguousarray(rows, dtype=self._type)
        out = np.zeros(3, dtype=self._type)
        self._library.published_take(
            self._state, ctypes.c_uint32(len(rows)), ctypes.c_void_p(rows.ctypes.data), ctypes.c_void_p(out.ctypes.data)
        )
        return out.astype(np.float64) * self._scale


def published_rows(samples: Samples, psi_f: float, scale: Array) -> Array:
    """Regressors times what the motor's parameters are about, and voltages: (n, 2, 4)."""
    i_d, i_q, x_d, x_q, y_d, y_q, s, _, u_d, u_q = flux_balance(samples).T
    d = np.stack((i_d * scale[0], x_d * scale[1], -y_q * scale[2], u_d), axis=1)
    q = np.stack((i_q * scale[0], y_d * scale[1], x_q * scale[2], u_q - psi_f * s), axis=1)
    return np.stack((d, q), axis=1)


def published_drift(samples: int, folder: Path, P_0: float) -> tuple[list[tuple[float, float]], int]:
    """Samples in millions, and by how much the published window is off its exact solution then; and its bytes."""
    scale = np.array([getattr(PAPER.motor, name) for name in THREE])
    published, drift, done = Published(folder, "float32", scale, P_0), list[tuple[float, float]](), 0
    before = np.empty((0, 2, 4))
    for _, block in blocks(PAPER, samples):
        rows = published_rows(block, PAPER.motor.psi_f, scale)
        found = published.take(rows)
        before = np.concatenate((before, rows))[-WINDOW:]
        flat = before.reshape(-1, 4)
        exact = np.linalg.lstsq(flat[:, :3], flat[:, 3], rcond=None)[0] * scale
        done += len(rows)
        drift.append((done / 1e6, float(np.max(np.abs(found / exact - 1.0)))))
    return drift, published.bytes


MAIN: Final = """
#include "pmsm_window.h"
static pmsm_window window;
static pmsm_estimates found;
%s
static float sines[64][2] = {%s};
static void measured(int samples, int solutions) {
    static const pmsm_settings settings = {1e-4f, {0.9664f, 4.24e-3f, 6.21e-3f, 0.12f}, 0, 0, 0, 8000};
    unsigned r = 1;
    int k;
    pmsm_window_init(&window, &settings);
    published_start();
    for (k = 0; k < samples; k++) {
        r = r * 1664525u + 1013904223u;
        pmsm_sample s = {sines[k & 63][0], sines[k & 63][1], (float)(r >> 28) * 0.1f, (float)(r >> 24 & 15) * 0.1f,
                         (float)(r >> 20 & 15), (float)(r >> 16 & 15)};
        STEP
    }
    while (solutions--)
        pmsm_window_solve(&window, (uint32_t)samples, &found);
}
"""
_BARE: Final = """
void _start(void) {
    measured(SAMPLES, SOLUTIONS);
    register int r0 __asm__("r0") = 0;
    register int r7 __asm__("r7") = 1;
    __asm__ volatile("svc 0" ::"r"(r0), "r"(r7));
    for (;;) {}
}
"""
_HOSTED: Final = "int main(void) { measured(SAMPLES, SOLUTIONS); return 0; }\n"
_STEPS: Final = {
    "nothing": ("static void published_start(void) {}", "found.value[0] += s.i_d + s.i_q + s.u_d + s.u_q;"),
    "module": ("static void published_start(void) {}", "pmsm_window_update(&window, (uint32_t)k + 1u, &s);"),
    "published": (
        '#define LENGTH 400u\n#include "published.c"\nstatic published other;\n'
        "static void published_start(void) { published_init(&other, 100.0f); }",
        "float z[2][4] = {{s.i_d, s.u_d, s.u_q, s.i_q}, {s.i_q, s.u_q, s.u_d, s.i_d}}; published_update(&other, z);",
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Counter:
    """How instructions are counted."""

    name: str
    compiler: Sequence[str]
    bare: bool
    tools: tuple[str, ...]

    @property
    def missing(self) -> list[str]:
        """What it lacks here."""
        return [tool for tool in self.tools if shutil.which(tool) is None]

    def instructions(self, folder: Path, what: str, samples: int, solutions: int) -> int:
        """Of a whole run."""
        head, step = _STEPS[what]
        angles = ", ".join(f"{{{np.sin(0.05 * k):.8f}f, {np.cos(0.05 * k):.8f}f}}" for k in range(64))
        text = MAIN % (head, angles) + (_BARE if self.bare else _HOSTED)
        (folder / "measured.c").write_text(text.replace("STEP", step), encoding="utf-8")
        program = folder / "measured"
        sources = [str(folder / name) for name in ("measured.c", "pmsm_window.c", "pmsm_solve.c")]
        libraries = ["-nostartfiles", "-Wl,-Ttext=0x10000", "-lm", "-lc", "-lgcc"] if self.bare else ["-lm"]
        flags = [f"-DSAMPLES={samples}", f"-DSOLUTIONS={solutions}", f"-I{folder}", f"-I{HERE}"]
        subprocess.run(
            [*self.compiler, *flags, *sources, "-o", str(program), *libraries], check=True, capture_output=True
        )
        return self._bare(program) if self.bare else self._hosted(program)

    @staticmethod
    def _bare(program: Path) -> int:
        log = program.with_suffix(".log")
        command = ["qemu-arm", "-cpu", "max", "-singlestep", "-d", "nochain,exec", "-D", str(log), str(program)]
        subprocess.run(command, check=True)
        with log.open("rb") as file:
            return sum(1 for line in file if line.startswith(b"Trace"))

    @staticmethod
    def _hosted(program: Path) -> int:
        command = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={program}.out", str(program)]
        said = subprocess.run(command, check=True, capture_output=True, text=True).stderr
        found = re.search(r"Collected : (\d+)", said)
        assert found is not None, said
        return int(found[1])

    def table(self, folder: Path) -> dict[str, float]:
        """A sample of each, and a solution."""
        n = 640  # samples between two counts
        per = {
            what: (self.instructions(folder, what, 420 + n, 0) - self.instructions(folder, what, 420, 0)) / n
            for what in _STEPS
        }
        solution = self.instructions(folder, "module", 420, 1) - self.instructions(folder, "module", 420, 0)
        return {
            "update": per["module"] - per["nothing"], "published": per["published"] - per["nothing"],
            "solution": float(solution),
        }


def counters() -> list[Counter]:
    """On the processor meant, and on this one."""
    return [
        Counter("Cortex-M4F, qemu-arm", ("arm-none-eabi-gcc", "-std=gnu99", *OPTIMISED[1:], *CORTEX), True,
                ("arm-none-eabi-gcc", "qemu-arm")),
        Counter("this machine, gcc", ("gcc", "-std=gnu99", *OPTIMISED[1:]), False, ("gcc", "valgrind")),
        Counter("this machine, clang", ("clang", "-std=gnu99", *OPTIMISED[1:]), False, ("clang", "valgrind")),
    ]  # fmt: skip


def size_of_code(folder: Path) -> str:
    """Bytes of code for a Cortex-M4F, in words."""
    if shutil.which("arm-none-eabi-gcc") is None:
        return "there is no arm-none-eabi-gcc here"
    said = list[str]()
    for level in ("-O2", "-Os"):
        command = ["arm-none-eabi-gcc", "-std=c99", level, "-fno-math-errno", *CORTEX, "-c"]
        total = 0
        for name in ("pmsm_window", "pmsm_solve"):
            output = folder / f"{name}.o"
            subprocess.run([*command, str(folder / f"{name}.c"), "-o", str(output)], check=True)
            sizes = subprocess.run(["arm-none-eabi-size", str(output)], check=True, capture_output=True, text=True)
            total += int(sizes.stdout.splitlines()[1].split()[0])
        said.append(f"{total:,} bytes with {level}")
    return ", ".join(said)


def main() -> int:
    """All of it: some minutes."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--samples", type=int, default=10_000_000)
    samples, good, per_sample = int(parser.parse_args().samples), list[bool](), list[float]()
    furthest, growth, astray, size, other_size = 0.0, 0.0, 0.0, 0, 0

    def bar(text: str, met: bool) -> None:
        good.append(met)
        print(f"  {'met' if met else 'MISSED':6} {text}", flush=True)

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        module = Module(WINDOW, THREE, "float32")
        written(module, folder)
        print(f"instructions, window of {WINDOW} samples, {len(THREE)} parameters, float32:")
        print(f"  {'':28}{'update':>10}{'published':>12}{'solution':>12}")
        for counter in counters():
            if counter.missing:
                print(f"  {counter.name:28}there is no {' and no '.join(counter.missing)} here")
                continue
            table = counter.table(folder)
            print(f"  {counter.name:28}{table['update']:10.0f}{table['published']:12.0f}{table['solution']:12,.0f}")
            per_sample += [table["update"], table["solution"]]
            bar(f"at most {BARS['instructions']} a sample", table["update"] <= BARS["instructions"])
        print(f"  code for a Cortex-M4F: {size_of_code(folder)}\n")

        print(f"C in float32 beside Python in float64, {samples:,} samples, compared every {EVERY}: largest relative "
              "difference; root mean square in the first and the last tenth")  # fmt: skip
        for title, (scenario, share) in drives().items():
            found, c = compared(scenario, int(share * samples), folder / "run")
            print(f"  {title}: standard errors within {found.of_std:.1e}, {found.statuses} of {found.compared} "
                  "statuses differ")  # fmt: skip
            for each in THREE:
                first, last = found.mean(each, 0.0, 0.1), found.mean(each, 0.9, 1.0)
                print(f"    {each:5} {found.worst(each):8.1e}   {first:8.1e} {last:8.1e}", flush=True)
            worst = max(found.worst(each) for each in THREE)
            furthest, size = max(furthest, worst), c.bytes
            bar(f"within {BARS['relative']:g}: {worst:.1e}", worst <= BARS["relative"])
            grows = max(found.mean(each, 0.5, 1.0) / max(found.mean(each, 0.0, 0.5), 1e-8) for each in THREE)
            growth = max(growth, grows)
            bar(f"no drift, second half over first: {grows:.2f}", grows < BARS["drift"])
        bar(f"bytes of the window, at most {BARS['bytes']:,}: {size:,}", size <= BARS["bytes"])

        print("\nThe published up- and downdate in float32, off the exact least squares of its window, by samples")
        for P_0 in (1.0, 100.0, 10_000.0):
            drift, other_size = published_drift(int(0.6 * samples), folder, P_0)
            places = sorted({0, *(len(drift) * k // 6 for k in range(1, 6)), len(drift) - 1})
            told = ", ".join(f"{drift[k][1]:.1e} at {drift[k][0]:.2g}" for k in places)
            print(f"  P_0 = {P_0:g}: {told} million; {other_size:,} bytes", flush=True)
            astray = max(astray, *(off for _, off in drift))
    figure = f"{furthest:.1e}; {growth:.2f} times; {size:,} bytes"
    record("estimates.c_module", f"{figure}; up- and downdate: {astray:.1e} off, {other_size:,} bytes", all(good))
    if per_sample:
        record("estimates.c_instructions", f"{per_sample[0]:.0f}; {per_sample[1]:,.0f}")
    return 0 if all(good) else 1


if __name__ == "__main__":
    sys.exit(main())
