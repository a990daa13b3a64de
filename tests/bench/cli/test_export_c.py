"""`pmsm-bench export-c`: a folder that compiles and agrees with itself, and what is refused, in one sentence."""

import shutil
import subprocess
from pathlib import Path

import pytest

from tests.conftest import COMMAND

FILES = {
    "README.md", "pmsm_check.c", "pmsm_rows.h", "pmsm_solve.c", "pmsm_vectors.h", "pmsm_window.c", "pmsm_window.h",
}  # fmt: skip


def export_c(*arguments: str | Path) -> "subprocess.CompletedProcess[str]":
    command = [*COMMAND, "export-c", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120.0, check=False)


def test_the_folder_holds_all_that_its_page_asks_to_compile_and_it_agrees(tmp_path: Path) -> None:
    out = tmp_path / "new" / "c"
    done = export_c("--window", "400", "--parameters", "R_s,L_d,L_q", "--type", "float32", "--out", out)
    assert (done.returncode, done.stderr) == (0, "")
    assert "R_s, L_d, L_q by the last 400 samples in float32, 13468 bytes of static memory" in done.stdout
    assert {path.name for path in out.iterdir()} == FILES
    page = (out / "README.md").read_text(encoding="utf-8")
    assert "R_s, L_d and L_q, psi_f held at known values, in float32" in page
    assert len(page.splitlines()) < 80
    if shutil.which("cc") is None:
        pytest.skip("there is no cc here")
    (line,) = (line.strip() for line in page.splitlines() if line.strip().startswith("cc "))
    checked = subprocess.run(line, shell=True, cwd=out, capture_output=True, text=True, check=False)
    assert (checked.returncode, checked.stdout.splitlines()[-1]) == (0, "all as expected"), checked


def test_files_that_are_there_are_not_written_over_unless_asked(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine", encoding="utf-8")
    arguments = ("--window", "50", "--parameters", "L_q", "--out", tmp_path)
    done = export_c(*arguments)
    assert done.returncode == 2
    assert done.stderr == (
        f"pmsm-bench: --out: {tmp_path} has files in it already, expected a new or an empty folder, or --force\n"
    )
    assert export_c(*arguments, "--force").returncode == 0
    assert {path.name for path in tmp_path.iterdir()} == FILES | {"notes.txt"}


@pytest.mark.parametrize(("arguments", "said"), [
    (("--parameters", "R_s,B"), "parameters are some of R_s, L_d, L_q, psi_f, got 'B'"),
    (("--type", "int16"), "type must be float32 or float64, got 'int16'"),
    (("--window", "2"), "window length must be 3 (3 parameters x 1 periods per row) to 1000000 samples, got 2"),
    (("--window", "100000"), "a window of 100000 samples takes 3,312,796 bytes, expected 1,048,576 at most"),
])  # fmt: skip
def test_what_cannot_be_is_refused_before_anything_is_written(
    tmp_path: Path, arguments: tuple[str, ...], said: str
) -> None:
    done = export_c(*arguments, "--out", tmp_path / "c")
    assert (done.returncode, done.stdout, done.stderr) == (2, "", f"pmsm-bench: {said}\n")
    assert not (tmp_path / "c").exists()


def test_a_folder_that_cannot_be_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine", encoding="utf-8")
    done = export_c("--out", tmp_path / "file")
    assert done.returncode == 2
    assert "file" in done.stderr and len(done.stderr.splitlines()) == 1
