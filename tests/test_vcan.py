"""CANopen over SocketCAN as an independent witness sees it, and a bus that goes down. Bytes by hand from CiA 301.

What is the same over every transport is in test_contract. `make test-vcan` runs both where there is a vcan0.
"""

import itertools
import re
import statistics
import struct
import subprocess
import time
from contextlib import suppress
from dataclasses import dataclass
from math import pi

import pytest

from drivers.block import Block
from drivers.connect import connect
from drivers.errors import ConnectError, LostError, RefusedError
from tests.served_drive import PATIENCE, first_blocks, joined, listening, until
from tests.transports import serving, vcan_url
from tests.witness import BUS, Seen, witness

pytestmark = pytest.mark.vcan

URL = f"canopen://socketcan/{BUS}/5"
ROWS = 100

# NMT: command and node. Boot-up and heartbeat: the state (CiA 301, 7.2.8)
PRE_OPERATIONAL, START = "000#8005", "000#0105"
BOOTED, BEAT_PRE_OPERATIONAL, BEAT_OPERATIONAL = "705#00", "705#7F", "705#05"


@dataclass(frozen=True)
class Session:
    """A session of our client with the drive: what it said and what passed."""

    seen: list[Seen]
    blocks: list[Block]
    omega_full: float

    @property
    def frames(self) -> list[str]:
        """The frames, as candump writes them."""
        return [seen.frame for seen in self.seen]

    def data(self, identifier: str) -> list[bytes]:
        """The data of every frame with an identifier."""
        return [seen.data for seen in self.seen if seen.frame.startswith(f"{identifier}#")]


@pytest.fixture(scope="module")
def session() -> Session:
    """Identity, values, a refusal, a stream; then half a second of rest."""
    vcan_url()
    with witness() as log, serving(URL):
        with connect(URL) as drive:
            drive.write("i_q_ref", 1.25)
            drive.write("stream_periods", 50.0)
            with suppress(RefusedError):
                drive.write("i_q_ref", 12.5)
            blocks = first_blocks(drive, ROWS)
            omega_full = drive.identity.omega_full
        left = len(log.frames())
        until(lambda: [seen.frame for seen in log.frames()[left:]].count(BEAT_PRE_OPERATIONAL) > 5, "no heartbeats")
        return Session(log.frames(), blocks, omega_full)


def test_the_first_that_a_node_sends_is_the_boot_up_message(session: Session) -> None:
    assert session.frames[0] == BOOTED
    assert session.frames.count(BOOTED) == 1


@pytest.mark.parametrize(
    ("what", "transfer"),
    [
        ("vendor", ["605#4018100100000000", "585#4318100100000000"]),
        ("product code, PMSM backwards", ["605#4018100200000000", "585#431810024D534D50"]),
        ("control period, 100000 ns", ["605#4000200200000000", "585#43002002A0860100"]),
        ("current of full scale, 24 A", ["605#4010200100000000", "585#431020010000C041"]),
        ("write 1.25 A", ["605#230023020000A03F", "585#6000230200000000"]),
        ("write 50 periods, two bytes", ["605#2B00200432000000", "585#6000200400000000"]),
        ("listen to node 127, 500 ms", ["605#23161001F4017F00", "585#6016100100000000"]),
        ("write 12.5 A, abort 0x06090030", ["605#2300230200004841", "585#8000230230000906"]),
        (
            "device name, 24 bytes in four segments",
            [
                "605#4008100000000000", "585#4108100018000000",
                "605#6000000000000000", "585#00" + b"pmsm-be".hex().upper(),
                "605#7000000000000000", "585#10" + b"nch vir".hex().upper(),
                "605#6000000000000000", "585#00" + b"tual dr".hex().upper(),
                "605#7000000000000000", "585#19" + b"ive".hex().upper() + "00000000",
            ],
        ),
    ],
)
def test_an_sdo_transfer_is_byte_by_byte_that_of_the_standard(session: Session, what: str, transfer: list[str]) -> None:
    sdo = [frame for frame in session.frames if frame.startswith(("605#", "585#"))]
    assert transfer in [sdo[k : k + len(transfer)] for k in range(len(sdo))], what


def test_a_stream_is_started_and_stopped_by_nmt(session: Session) -> None:
    commands = [frame for frame in session.frames if frame.startswith("000#")]
    assert [command for command, _ in itertools.groupby(commands)] == [PRE_OPERATIONAL, START, PRE_OPERATIONAL]
    rows = [k for k, frame in enumerate(session.frames) if frame[:4] in ("185#", "285#", "385#", "485#")]
    stopped = session.frames.index(PRE_OPERATIONAL, session.frames.index(START))
    assert session.frames.index(START) < rows[0]
    assert rows[-1] < session.frames.index(BEAT_PRE_OPERATIONAL, stopped)  # the node's own word that it has stopped


def test_every_row_that_passed_is_what_the_client_gave_out(session: Session) -> None:
    rows = dict[int, tuple[float, ...]]()
    for one, two, three in zip(session.data("185"), session.data("285"), session.data("385"), strict=False):
        tick, theta_e, i_d, i_q = struct.unpack("<HHhh", one)
        tick_2, omega_e, u_d, u_q = struct.unpack("<Hhhh", two)
        tick_3, u_dc, i_d_mean, i_q_mean = struct.unpack("<Hhhh", three)
        assert tick == tick_2 == tick_3
        A, V = 24.0 / 32768.0, 387.5 / 32768.0
        rows[tick] = (
            theta_e * 2.0 * pi / 65536.0, omega_e * session.omega_full / 32768.0, i_d * A, i_q * A, u_d * V, u_q * V,
            i_d_mean * A, i_q_mean * A, u_dc * V,
        )
    names = ("theta_e", "omega_e", "i_d", "i_q", "u_d", "u_q", "i_d_mean", "i_q_mean", "u_dc")
    given = zip(*(joined(session.blocks, name) for name in names), strict=True)
    ticks = joined(session.blocks, "tick") & 0xFFFF
    assert len(ticks) >= ROWS
    passed = list(rows)
    first = passed.index(ticks[0])
    assert first <= 1  # a row that was under way at the start is not given out
    assert passed[first : first + len(ticks)] == ticks.tolist()
    for tick, values in zip(ticks.tolist(), given, strict=True):
        assert values == pytest.approx(rows[tick], rel=1e-12), tick


def test_the_slow_message_tells_the_temperatures_in_hundredths_of_a_degree(session: Session) -> None:
    assert {data[2:] for data in session.data("485")} == {struct.pack("<hh", 2340, 2340)}


def test_a_node_beats_every_tenth_of_a_second_and_tells_its_state(session: Session) -> None:
    beats = [seen for seen in session.seen if seen.frame in (BEAT_OPERATIONAL, BEAT_PRE_OPERATIONAL)]
    assert [state for state, _ in itertools.groupby(beat.frame for beat in beats)] == [
        BEAT_PRE_OPERATIONAL, BEAT_OPERATIONAL, BEAT_PRE_OPERATIONAL,
    ]
    between = [two.time - one.time for one, two in itertools.pairwise(beats)]
    assert statistics.median(between) == pytest.approx(0.1, abs=0.05)  # a machine held up runs in steps of 50 ms
    assert max(between) < 1.0


def test_the_bench_beats_as_an_operational_node(session: Session) -> None:
    assert set(session.data("77F")) == {b"\x05"}


def test_the_bus_carries_nothing_else(session: Session) -> None:
    known = {"000", "185", "285", "385", "485", "585", "605", "705", "77F"}
    assert {frame.partition("#")[0] for frame in session.frames} == known


def test_a_bus_that_goes_down_is_told_in_a_sentence_and_works_again_when_it_is_up() -> None:
    url = vcan_url()
    with serving(url) as bench, connect(url) as drive, listening(drive) as listener:
        set_link("down")
        try:
            begun = time.monotonic()
            error = listener.ended()
            assert time.monotonic() - begun < 3.0
            assert isinstance(error, LostError)
            assert re.search(rf"socketcan {BUS} (is gone|fell silent): ", str(error))
            with pytest.raises(ConnectError, match=f"socketcan {BUS} no longer takes frames: .*Network is down"):
                connect(url)
        finally:
            set_link("up")
        # The kernel tells one thread of each process: a drive whose reader hears of it ends, else it goes on
        if bench.process.poll() is not None:
            assert bench.process.returncode == 2
            said = bench.process.communicate()[1]
            assert said.startswith("pmsm-bench emulate: the CAN bus socketcan ")
            assert said.count("\n") == 1
    with serving(url), connect(url) as again:
        assert len(first_blocks(again, 20)) > 0


def set_link(state: str) -> None:
    """Take the interface down, or up."""
    subprocess.run(["busybox", "ip", "link", "set", BUS, state], check=True, timeout=PATIENCE)
