"""The C module says what Python says of the same window: values, standard errors, statuses; of emulated drives."""

import math
import shutil
import subprocess
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.scenarios import PAPER, PAPER_RUN, Scenario
from estimator.export_c.module import Module, module_of
from estimator.export_c.vectors import header, statuses
from estimator.machine import PARAMETERS
from estimator.online import window_ls
from estimator.online.estimate import Status, WindowEstimate
from estimator.samples import Samples
from tests.estimator.export_c.c_window import STRICT, CWindow, Estimates, as_samples, written
from tests.support.samples import recorded

pytestmark = [
    pytest.mark.thorough, pytest.mark.skipif(shutil.which("gcc") is None, reason="there is no gcc here"),
]  # fmt: skip

TRUTH = {"R_s": 0.9664, "L_d": 4.24e-3, "L_q": 6.21e-3, "psi_f": 0.12}  # ohm, H, H, Vs
THREE = ("R_s", "L_d", "L_q")
OFF = 1.1  # times the truth is what is known of what is estimated


@pytest.fixture(params=["gcc", "clang"])
def compiler(request: pytest.FixtureRequest) -> str:
    name = str(request.param)
    if shutil.which(name) is None:
        pytest.skip(f"there is no {name} here")
    return name


def known_of(estimated: tuple[str, ...], off: float = OFF) -> dict[str, float]:
    return {name: value * (off if name in estimated else 1.0) for name, value in TRUTH.items()}


class Both:
    """One stream through both."""

    def __init__(self, folder: Path, compiler: str, module: Module, off: float = OFF) -> None:
        self.module, self.known = module, known_of(module.estimated, off)
        self.c = CWindow(module, self.known, 1e-4, folder, compiler)
        self.python = window_ls.init(module.window)

    def take(self, samples: Samples, *, after: int = 1) -> None:
        window_ls.update(self.python, samples, joined=after == 1)
        self.c.take(as_samples(samples), after=after)

    def said(self) -> tuple[WindowEstimate, Estimates]:
        return window_ls.estimate(self.python, self.module.estimated, self.known), self.c.solve()

    def agree(self, value: float = 1e-4, std: float = 0.02) -> Mapping[str, Status]:
        """Compare, and the statuses of both."""
        python, c = self.said()
        assert (c.samples, c.gaps) == (python.samples, python.gaps)
        expected = statuses(python)
        assert {name: each.status for name, each in c.of.items()} == expected
        for name, each in python.estimates.items():
            if each.std is not None and each.value is not None:
                assert c.of[name].value == pytest.approx(each.value, rel=value), name
                assert c.of[name].std == pytest.approx(each.std, rel=std), name
        return expected


def both(tmp_path: Path, compiler: str, estimated: tuple[str, ...] = THREE, kind: str = "float32") -> Both:
    return Both(tmp_path, compiler, module_of(400, estimated, kind))


@pytest.mark.parametrize("kind", ["float32", "float64"])
@pytest.mark.parametrize("estimated", [THREE, PARAMETERS, ("L_q",), ("R_s", "psi_f")])
def test_any_parameters_come_out_as_in_python(
    tmp_path: Path, compiler: str, estimated: tuple[str, ...], kind: str
) -> None:
    drive, run = VirtualDrive(PAPER), both(tmp_path, compiler, estimated, kind)
    for _ in range(60):
        run.take(recorded(drive, 137))
        said = run.agree(1e-4 if kind == "float32" else 5e-6)
        assert all(said[name] is Status.OK for name in estimated)


def test_the_module_needs_no_nominal_values_of_what_it_estimates(tmp_path: Path, compiler: str) -> None:
    drive, run = VirtualDrive(PAPER), Both(tmp_path, compiler, module_of(400, THREE, "float32"), off=0.0)
    for _ in range(40):
        run.take(recorded(drive, 137))
        run.agree()


@pytest.mark.parametrize("scenario", [PAPER, PAPER_RUN], ids=["paper", "paper_run"])
@pytest.mark.parametrize("window", [40, 256, 777])
def test_windows_of_any_length_come_out_as_in_python(
    tmp_path: Path, compiler: str, scenario: Scenario, window: int
) -> None:
    drive, run = VirtualDrive(scenario), Both(tmp_path, compiler, module_of(window, THREE, "float32"))
    for size in (33, 7, 256, 500, 123, 1, 31, 1024):
        run.take(recorded(drive, size))
        run.agree()


def test_gaps_in_ticks_end_a_run(tmp_path: Path, compiler: str) -> None:
    drive, run = VirtualDrive(PAPER), both(tmp_path, compiler)
    for after in (1, 5, 1, 2, 40_000):
        drive.run(after - 1)
        run.take(recorded(drive, 150), after=after)
        run.agree()
    assert run.said()[1].gaps == 2


def test_counts_of_rows_and_ticks_may_wrap(tmp_path: Path, compiler: str) -> None:
    drive, run = VirtualDrive(PAPER), both(tmp_path, compiler)
    run.c.count_from(2**32 - 512)
    run.c.tick = 2**32 - 400
    for size in (300, 100, 90, 20, 10, 400, 300):
        run.take(recorded(drive, size))
        assert all(run.agree()[name] is Status.OK for name in THREE)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_samples_that_are_no_numbers_are_left_out(tmp_path: Path, compiler: str, bad: float) -> None:
    drive, run = VirtualDrive(PAPER), both(tmp_path, compiler)
    samples = recorded(drive, 600)
    for column, place in (("i_d", 300), ("u_q", 301), ("i_q", 420)):
        values = getattr(samples, column).copy()
        values[place] = bad
        samples = replace(samples, **{column: values})
    run.take(samples)
    assert all(run.agree()[name] is Status.OK for name in THREE)
    assert run.said()[1].gaps == 2


def test_too_few_rows_are_no_data(tmp_path: Path, compiler: str) -> None:
    drive, run = VirtualDrive(PAPER), both(tmp_path, compiler)
    for _ in range(2):  # a sample alone is no row
        run.take(recorded(drive, 1))
        assert [run.agree()[name] for name in PARAMETERS] == [*[Status.NO_DATA] * 3, Status.HELD]


def test_currents_that_stay_tell_one_parameter_in_place_of_three(tmp_path: Path, compiler: str) -> None:
    steady = replace(PAPER, excitation=replace(PAPER.excitation, i_d_step=0.0, i_q_step=0.0))
    drive, run = VirtualDrive(steady), both(tmp_path, compiler, PARAMETERS)
    drive.run(5000)
    for _ in range(10):
        run.take(recorded(drive, 97))
        said = run.agree(value=5e-4, std=0.3)  # a tenth of a standard error
        assert said["L_d"] is Status.NOT_TOLD


@pytest.mark.parametrize("estimated", [THREE, PARAMETERS])
def test_a_motor_that_stands_still_tells_its_resistance_at_most(
    tmp_path: Path, compiler: str, estimated: tuple[str, ...]
) -> None:
    still = replace(
        PAPER, run=replace(PAPER.run, speed_rpm=0.0),
        excitation=replace(PAPER.excitation, i_d_step=0.0, i_q_step=0.0),
    )  # fmt: skip
    drive, run = VirtualDrive(still), both(tmp_path, compiler, estimated)
    drive.run(5000)
    run.take(recorded(drive, 500))
    said = run.agree(std=0.25)
    assert {said[name] for name in estimated if name != "R_s"} == {Status.NOT_TOLD}


def test_currents_that_are_cut_off_come_out_as_in_python(tmp_path: Path, compiler: str) -> None:
    drive, run = VirtualDrive(PAPER), both(tmp_path, compiler)
    samples = recorded(drive, 1000)
    run.take(replace(samples, i_d=np.clip(samples.i_d, -1.0, 1.0), i_q=np.clip(samples.i_q, 0.0, 2.5)))
    run.agree()
    run.take(replace(recorded(drive, 1000), i_d=np.full(1000, 1.0), i_q=np.full(1000, 2.5)))
    run.agree(std=0.05)


def test_what_no_motor_has_is_doubtful(tmp_path: Path, compiler: str) -> None:
    drive, run = VirtualDrive(PAPER), both(tmp_path, compiler)
    samples = recorded(drive, 1000)
    run.take(replace(samples, u_d=1e4 * samples.u_d, u_q=1e4 * samples.u_q))
    assert Status.DOUBTFUL in run.agree(value=1e-3, std=0.2).values()


def test_estimates_of_rows_that_are_too_old_are_stale(tmp_path: Path, compiler: str) -> None:
    drive = VirtualDrive(PAPER)
    c = CWindow(module_of(400, THREE, "float32"), known_of(THREE), 1e-4, tmp_path, compiler, stale_after=8000)
    c.take(as_samples(recorded(drive, 1000)))
    for later, status in ((0, Status.OK), (8000, Status.OK), (8001, Status.STALE)):
        said = c.solve(later=later).of
        assert [said[name].status for name in PARAMETERS] == [*[status] * 3, Status.HELD]


@pytest.mark.parametrize(("window", "estimated", "kind"), [
    (400, THREE, "float32"), (400, THREE, "float64"), (33, PARAMETERS, "float64"), (31, ("psi_f",), "float32"),
])  # fmt: skip
def test_the_window_takes_as_many_bytes_as_its_page_says(
    tmp_path: Path, window: int, estimated: tuple[str, ...], kind: str
) -> None:
    module = module_of(window, estimated, kind)
    assert CWindow(module, TRUTH, 1e-4, tmp_path).bytes == module.bytes


def test_400_samples_of_three_parameters_take_less_than_16_kilobytes() -> None:
    assert module_of(400, THREE, "float32").bytes <= 16_000


@pytest.mark.parametrize("estimated", [THREE, PARAMETERS])
@pytest.mark.parametrize("kind", ["float32", "float64"])
def test_test_vectors_pass_and_a_changed_one_does_not(
    tmp_path: Path, compiler: str, estimated: tuple[str, ...], kind: str
) -> None:
    module = module_of(200, estimated, kind)
    folder, vectors = written(module, tmp_path), header(module)
    for text, code in ((vectors, 0), (vectors.replace("PMSM_NOT_TOLD", "PMSM_OK", 1), 1)):
        (folder / "pmsm_vectors.h").write_text(text, encoding="utf-8")
        files = [str(folder / name) for name in ("pmsm_check.c", "pmsm_window.c", "pmsm_solve.c")]
        subprocess.run([compiler, *STRICT, *files, "-o", str(folder / "check"), "-lm"], check=True)
        done = subprocess.run([str(folder / "check")], capture_output=True, text=True, check=False)
        assert done.returncode == code, done.stdout


@pytest.mark.parametrize(("window", "estimated", "kind", "said"), [
    (400, ["R_s", "L_x"], "float32", "got 'L_x'"),
    (400, [], "float32", "one at least, got none"),
    (400, ["R_s", "R_s"], "float32", "each parameter once"),
    (400, ["R_s"], "float16", "got 'float16'"),
    (2, ["R_s", "L_d", "L_q"], "float32", "must be 3 (3 parameters x 1 periods per row) to"),
    (500_000, ["R_s"], "float32", "16,562,796 bytes, expected 1,048,576 at most"),
])  # fmt: skip
def test_what_cannot_be_is_refused_in_a_sentence(window: int, estimated: list[str], kind: str, said: str) -> None:
    with pytest.raises(ValueError, match=r"got|expected") as refused:
        module_of(window, estimated, kind)
    assert said in str(refused.value)
