"""A serial line at a path: one emulator's at a time, and free again when that is gone, however it went."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from drivers.connect import connect
from emulator.errors import BusError
from emulator.servers.terminal import Terminal
from tests.support.served_drive import emulator, ready
from tests.support.transports import modbus_pty_url, pty_url

pytestmark = pytest.mark.live


@pytest.mark.parametrize("new_url", [pty_url, modbus_pty_url])
def test_a_line_in_use_is_refused_and_stays_with_whom_it_is_until_that_one_is_killed(
    new_url: Callable[[], str]
) -> None:
    url = new_url()
    path = url.partition("://")[2].partition("?")[0]
    with emulator("--at", url) as first:
        ready(first)
        target = Path(path).readlink()
        with connect(url) as drive:
            drive.write("i_q_ref", 1.25)
        with emulator("--at", url) as second:
            out, errors = second.communicate(timeout=60.0)
        assert (second.returncode, out) == (2, "")
        assert errors == f"pmsm-bench emulate: cannot serve a serial line at {path}: it is already in use\n"
        assert Path(path).readlink() == target
        with connect(url) as drive:
            assert drive.read("i_q_ref") == 1.25
    assert Path(path).is_symlink()  # the first has been killed
    with emulator("--at", url) as third:
        ready(third)
        with connect(url) as drive:
            assert drive.read("u_full") == 387.5
        third.terminate()
        assert third.wait(10.0) == 0
    assert not Path(path).is_symlink()


def closed(terminal: Terminal) -> None:
    os.close(terminal.near)
    terminal.close()


def test_a_link_to_a_number_that_another_terminal_has_been_given_since_is_replaced(tmp_path: Path) -> None:
    near, far = os.openpty()
    left = tmp_path / "left"
    left.symlink_to(os.ttyname(far))
    earlier = os.fstat(far).st_ctime_ns - 1_000_000_000
    os.utime(left, ns=(earlier, earlier), follow_symlinks=False)
    terminal = Terminal(left)
    assert str(left.readlink()) == os.ttyname(terminal.far) != os.ttyname(far)
    closed(terminal)
    for descriptor in (near, far):
        os.close(descriptor)


def test_at_the_end_a_link_of_another_stays(tmp_path: Path) -> None:
    mine = Terminal(tmp_path / "line")
    (tmp_path / "line").unlink()
    other = Terminal(tmp_path / "line")
    closed(mine)
    assert str((tmp_path / "line").readlink()) == os.ttyname(other.far)
    closed(other)
    assert not (tmp_path / "line").is_symlink()


def test_what_is_no_line_of_an_emulator_is_left_alone(tmp_path: Path) -> None:
    for name, target in (("adapter", tmp_path / "unplugged"), ("usb", Path("/dev/null"))):
        (tmp_path / name).symlink_to(target)
        with pytest.raises(BusError, match=f"cannot serve a serial line at .*/{name}: File exists"):
            Terminal(tmp_path / name)
        assert (tmp_path / name).readlink() == target
