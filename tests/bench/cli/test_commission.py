"""`pmsm-bench commission`: an emulated drive that nobody knows, taken to what it should be; and what is refused."""

import html.parser
import json
import math
import subprocess
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import pytest

from drivers.connect import connect
from emulator.plant.physics.legs import Inverter
from emulator.scenario.scenarios import Scenario
from emulator.scenario.text import text_of
from tests.bench.commissioning.unknown import is_off, unknown, watched
from tests.conftest import COMMAND, command, free_port, wait_for_answer
from tests.support.served_drive import emulator, ready, tcp_url, until

pytestmark = pytest.mark.live

SHEET = {"R_s": 0.78, "L_d": 5.1e-3, "L_q": 5.2e-3, "psi_f": 0.145}  # what the motor was said to be
MACHINE = """[machine]
R_s = 0.78
L_d = 5.1e-3
L_q = 5.2e-3
psi_f = 0.145
{more}
i_rated = 6.0
speed_max_rpm = 1500.0
"""


class Tags(html.parser.HTMLParser):
    """Whether what is opened is closed."""

    EMPTY = ("meta", "link", "br", "hr", "img", "input", "path", "line", "rect", "circle", "polyline", "polygon", "use")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open, self.wrong = list[str](), list[str]()
        self.feed(text)
        self.wrong += self.open

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        if tag not in self.EMPTY:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag in self.EMPTY:
            return
        if not self.open or self.open.pop() != tag:
            self.wrong.append(tag)


@contextmanager
def bench(scenario: Scenario, folder: Path, machine: str) -> Generator[tuple[str, str]]:
    """The URL of a drive of a process of its own, and of a service over it."""
    url, port = tcp_url(), free_port()
    (folder / "unknown.toml").write_text(text_of(scenario), encoding="utf-8")
    (folder / "m.toml").write_text(machine, encoding="utf-8")
    (folder / "bench.toml").write_text(
        f'[service]\nport = {port}\ncaptures = "c"\nlog = "log"\njournals = "j"\ndatabase = "c.sqlite"\n'
        f'[drives.x]\nurl = "{url}"\nmachine = "m.toml"\n', encoding="utf-8",
    )  # fmt: skip
    root = f"http://127.0.0.1:{port}"
    with (
        emulator("--at", url, "--scenario", str(folder / "unknown.toml"), control="lease") as process,
        command("serve", "--config", str(folder / "bench.toml")) as service,
    ):
        ready(process)
        wait_for_answer(f"{root}/api/health", service)
        until(lambda: httpx.get(f"{root}/api/drives/x").json()["link"]["state"] == "streaming", "the link")
        yield url, root


def said(folder: Path, *arguments: str, codes: tuple[int, ...] = (0,)) -> str:
    """What the command prints."""
    done = subprocess.run(
        [*COMMAND, *arguments], cwd=folder, capture_output=True, text=True, timeout=400, check=False,
        stdin=subprocess.DEVNULL,
    )  # fmt: skip
    assert done.returncode in codes, done
    return done.stdout + done.stderr


def test_where_nobody_can_be_asked_it_is_refused_and_nothing_moves(tmp_path: Path) -> None:
    with bench(unknown(), tmp_path, MACHINE.format(more="n_p = 4")) as (url, root):
        with connect(url) as drive:
            before = watched(drive)
        service = ("--service", root)
        text = said(tmp_path, "commission", "x", "--first-start", *service, codes=(2,))
        assert "pmsm-bench: expected --yes, as nobody can be asked here" in text
        (tmp_path / "there.html").write_text("a page")
        there = said(tmp_path, "commission", "x", "--yes", "--report", "there.html", *service, codes=(2,))
        assert "there.html" in there
        assert "no drive 'y'" in said(tmp_path, "commission", "y", "--yes", *service, codes=(2,))
        fast = said(tmp_path, "commission", "x", "--yes", "--bandwidth", "9000", *service, codes=(2,))
        assert "bandwidth: expected at most 3333 rad/s" in fast
        assert httpx.get(f"{root}/api/drives/x/commissionings").json()["commissionings"] == []
        with connect(url) as drive:
            assert watched(drive) == before
            assert is_off(drive)
    assert (tmp_path / "there.html").read_text() == "a page"


@pytest.mark.slow
def test_a_doubtful_set_is_not_flashed_unless_somebody_says_why(tmp_path: Path) -> None:
    scenario = unknown(settings={"n_p": 4.0})
    with bench(scenario, tmp_path, MACHINE.format(more="n_p = 5")) as (url, root):
        text = said(
            tmp_path, "commission", "x", "--first-start", "--yes", "--report", "r.html", "--service", root, codes=(1,)
        )
        assert "doubtful: n_p is doubtful (first start; the machine file says 5 pole pairs)" in text
        assert "nothing is flashed; --override REASON says why it may be" in text
        assert httpx.get(f"{root}/api/drives/x/flashes").json()["total"] == 0
        with connect(url) as drive:
            assert (drive.read("angle_offset"), is_off(drive)) == (0.0, True)


@pytest.mark.thorough
def test_a_motor_that_nobody_knows_comes_to_run_as_it_is_tuned(tmp_path: Path) -> None:
    plain = unknown(J=1e-3, encoder_reversed=True, bridge="switched", settings={
        "n_p": 2.0, **{f"control_{name}": value for name, value in SHEET.items()},
    })  # fmt: skip
    scenario = replace(
        plain, effects=plain.effects._replace(inverter=Inverter(dead_time=2e-6)),
        run=replace(plain.run, speed_control=True, speed_reference="ramp", speed_bandwidth=25.0),
    )  # fmt: skip
    with bench(scenario, tmp_path, MACHINE.format(more="")) as (url, root):
        service = ("--service", root)
        text = said(tmp_path, "commission", "x", "--first-start", "--yes", "--report", "r.html", *service)
        jobs = httpx.get(f"{root}/api/drives/x/commissionings").json()["commissionings"]
        assert [(job["request"]["kind"], job["state"]) for job in jobs] == [
            ("verify", "done"), ("identify", "done"), ("first_start", "done")
        ]  # fmt: skip
        after, found, first = (job["result"] for job in jobs)
        (tmp_path / "set.toml").write_text(found["set"], encoding="utf-8")
        said(tmp_path, "params", "verify", "set.toml", "x", *service)
        with connect(url) as drive:
            assert is_off(drive)
            assert (drive.read("n_p"), drive.read("phases_swapped")) == (4.0, 1.0)
            assert drive.read("dead_time") == pytest.approx(2e-6, rel=0.05)
    assert first["said"].startswith("4 pole pairs; the encoder counts against the field")
    for name in SHEET:
        told, truth = found["machine"][name], getattr(scenario.motor, name)
        assert told["value"] == pytest.approx(truth, abs=max(0.01 * truth, 2.0 * told["std"])), name
    assert found["shaft"]["estimates"]["J"]["value"] == pytest.approx(scenario.motor.J, rel=0.02)
    for before, now in zip(found["loops"], after["loops"], strict=True):
        assert now["tracking"] < (before["tracking"] or math.inf), now["name"]  # dead time swallowed steps before
        assert now["overshoot"] == pytest.approx(now["promised_overshoot"], abs=0.1), now["name"]
        assert now["settling"] < 1.6 * now["promised_settling"], now["name"]
    speed_before, speed = found["loops"][0], after["loops"][0]
    assert speed["settling"] == pytest.approx(speed["promised_settling"], rel=0.15)
    assert speed["tracking"] < 0.5 * speed_before["tracking"]
    assert "flashed" in text
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert Tags(page).wrong == []
    assert page.lower().startswith("<!doctype html>")
    for number in ("4 pole pairs", "inverter", "the set was flashed, stored, and read back after a reset", "kg m"):
        assert number in page, number
    assert json.dumps(found)  # plain values
