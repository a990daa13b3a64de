"""`python -m emulator` as a process: how it starts, what it says when it cannot, how it ends, what time it keeps."""

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers.connect import connect
from drivers.drive import Drive
from tests.support.served_drive import READY, emulator, ready, tcp_url
from tests.support.transports import modbus_tcp_url, serial_socket_url

pytestmark = pytest.mark.live

SMALL = """
[motor]
R_s = 0.5
L_d = 1e-3
L_q = 1.5e-3
psi_f = 0.05
n_p = 3
i_rated = 4.0
"""


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    """Where an emulator runs in a process of its own."""
    place = tcp_url()
    with emulator("--at", place) as process:
        assert ready(process) == f"emulated drive 'paper' is at {place}\n"
        yield place


def refused(*arguments: str) -> str:
    """What a start that cannot be says."""
    done = subprocess.run(
        [sys.executable, "-m", "emulator", *arguments], capture_output=True, text=True, timeout=READY, check=False
    )
    assert done.returncode == 2
    assert done.stdout == ""
    return done.stderr


def test_a_place_that_cannot_be_is_one_sentence_and_exit_2() -> None:
    said = refused("--at", "nonsense")
    assert said == (
        "pmsm-bench emulate: expected a URL that starts with canopen:// or modbus+tcp:// or modbus+rtu:// "
        "or uart://, got 'nonsense'\n"
    )


def test_a_port_in_use_is_one_sentence_and_exit_2(url: str) -> None:
    said = refused("--at", url)
    assert said.startswith("pmsm-bench emulate: cannot serve a CAN bus at 127.0.0.1:")
    assert said.endswith(": Address already in use\n")
    assert said.count("\n") == 1


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (None, "scenario.toml: no such file"),
        (SMALL.replace("0.5", "-0.5"), "scenario.toml: motor.R_s takes above 0 ohm, got -0.5"),
    ],
)
def test_a_scenario_that_cannot_be_is_one_sentence_and_exit_2(
    tmp_path: Path, text: str | None, sentence: str
) -> None:
    file = tmp_path / "scenario.toml"
    if text is not None:
        file.write_text(text)
    said = refused("--at", tcp_url(), "--scenario", str(file))
    assert said.removeprefix("pmsm-bench emulate: ").removeprefix(f"{tmp_path}/").startswith(sentence)
    assert said.count("\n") == 1


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (None, "cannot read the faults in {file}: No such file or directory"),
        ("reset@1\n# later\n\nexplode@5\n", "{file}, line 4: expected a fault as lose=RATE, "),
        ("lose=2 # twice\n", "{file}, line 1: expected a rate of 0 to 1 in 'lose=2', got 2"),
    ],
)
def test_a_fault_script_that_cannot_be_is_one_sentence_and_exit_2(
    tmp_path: Path, text: str | None, sentence: str
) -> None:
    file = tmp_path / "faults"
    if text is not None:
        file.write_text(text)
    said = refused("--at", tcp_url(), "--fault-script", str(file))
    assert said.startswith("pmsm-bench emulate: " + sentence.format(file=file))
    assert said.count("\n") == 1


def test_bus_off_without_a_can_link_is_one_sentence_and_exit_2() -> None:
    said = refused("--at", modbus_tcp_url(), "--at", serial_socket_url(), "--fault", "busoff@5+2")
    assert said == "pmsm-bench emulate: expected a CAN link (--at canopen://...) for busoff, there is none\n"


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_scenario_from_a_file_is_served_until_a_signal_ends_it_at_once(
    tmp_path: Path, number: signal.Signals
) -> None:
    file, place = tmp_path / "small.toml", tcp_url()
    file.write_text(SMALL)
    with emulator("--at", place, "--scenario", str(file)) as process:
        assert ready(process) == f"emulated drive 'small.toml' is at {place}\n"
        with connect(place) as drive:
            assert (drive.read("control_R_s"), drive.read("n_p"), drive.identity.i_full) == (0.5, 3.0, 16.0)
            next(iter(drive.stream()))
            begun = time.monotonic()
            process.send_signal(number)
            out, err = process.communicate(timeout=10.0)
            assert time.monotonic() - begun < 5.0
        assert process.returncode == 0
        assert (out, err) == ("", "")


def test_values_are_served_while_nothing_streams(url: str) -> None:
    with connect(url) as drive:
        begun = time.monotonic()
        for _ in range(100):
            assert drive.read("u_full") == 387.5
        assert time.monotonic() - begun < 2.0


def _ticks(drive: Drive) -> tuple[float, float]:
    """The drive's tick and the time at which it was asked for, in s."""
    asked = time.monotonic()
    tick = drive.read("tick")
    return tick, (asked + time.monotonic()) / 2.0


@pytest.mark.slow
def test_it_keeps_real_time_while_it_streams(url: str) -> None:
    with connect(url) as drive:
        first_tick, first_time = _ticks(drive)
        rows, end = 0, first_time + 5.0
        blocks = drive.stream()
        for block in blocks:
            rows += len(block)
            assert block.lost_before == 0
            if time.monotonic() > end:
                break
        last_tick, last_time = _ticks(drive)
        passed = last_time - first_time
        assert last_tick - first_tick == pytest.approx(1e4 * passed, rel=0.01)
        assert rows == pytest.approx(1e3 * passed, rel=0.02)
