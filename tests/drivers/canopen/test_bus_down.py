"""A CAN interface that goes down or away under both ends: a sentence in the client, service again when it is back."""

import errno
import uuid
from collections.abc import Iterator

import pytest

from drivers.connect import connect
from drivers.errors import ConnectError, LostError
from emulator.errors import BusError
from tests.drivers.canopen.falling_bus import troubles
from tests.support.driving import driving
from tests.support.served_drive import first_blocks, listening, until

pytestmark = pytest.mark.live


@pytest.fixture
def channel() -> Iterator[str]:
    name = uuid.uuid4().hex
    yield name
    troubles.pop(name, None)


@pytest.mark.parametrize(
    ("number", "words"), [(errno.ENETDOWN, "Network is down"), (errno.ENODEV, "No such device")], ids=["down", "gone"]
)
def test_an_interface_that_goes_is_told_at_both_ends_and_served_again_when_it_is_back(
    channel: str, number: int, words: str, capfd: pytest.CaptureFixture[str]
) -> None:
    url = f"canopen://falling/{channel}/5"
    with driving(url) as running, connect(url) as drive:
        with listening(drive) as listener:
            troubles[channel] = number
            error = listener.ended()
            assert isinstance(error, LostError)
            assert str(error).startswith(f"falling {channel} is gone: ")  # by whichever thread met it first
            assert f"[Errno {number}] {words}" in str(error)
            with pytest.raises(LostError, match=f"falling {channel} no longer takes frames: .*{words}"):
                drive.write("i_q_ref", 1.0)
        with pytest.raises(ConnectError, match=words):
            connect(url)
        tick = running.drive.tick
        until(lambda: running.drive.tick > tick + 15_000, "its time stands still")
        del troubles[channel]
        if number == errno.ENODEV:  # else the node waits in silence
            said: list[str] = []

            def told_again() -> bool:
                said.extend(capfd.readouterr().err.splitlines())
                return f"pmsm-bench emulate: {url} is served again" in said

            until(told_again, "nothing is said")
            assert all(line.startswith("pmsm-bench emulate: ") and words in line for line in said[:-1]), said
            assert 2 <= len(said) <= 3  # gone, perhaps that it cannot be opened, and served again
        with connect(url) as again:
            assert len(first_blocks(again, 50)) > 0
    assert capfd.readouterr().err == ""


def test_an_interface_that_takes_no_frame_is_told_and_one_that_does_again_is_served_on(channel: str) -> None:
    url = f"canopen://falling/{channel}/5"
    with driving(url), connect(url) as drive:
        troubles[channel] = errno.ENOBUFS
        with pytest.raises(LostError, match=f"falling {channel} no longer takes frames: .*No buffer space available"):
            drive.read("u_full")
        del troubles[channel]
        until(lambda: len(first_blocks(drive, 20)) > 0, "no rows")


def test_an_interface_that_is_not_there_at_first_is_told(channel: str) -> None:
    troubles[channel] = errno.ENODEV
    with pytest.raises(BusError, match=f"no CAN bus falling {channel}: .*No such device"), driving(
        f"canopen://falling/{channel}/5"
    ):
        pass
