"""One emulated drive over every transport at once, and the real service over them: loss, return, resets, faults."""

import contextlib
import itertools
import threading
import time
from collections.abc import Generator
from pathlib import Path

import canopen
import pytest

from bench.config import Config, DriveConfig
from bench.errors import BenchError
from bench.live.acquisition import Link, LinkState
from bench.live.window import Window
from bench.service.service import Service
from drivers import operation
from drivers.connect import connect
from drivers.drive import Drive
from drivers.errors import DriveError, RefusedError
from drivers.wire import canopen_od as od
from drivers.wire.can_url import parse_can_url
from drivers.wire.cia402 import State
from tests.conftest import command
from tests.support.driving import driving
from tests.support.served_drive import Listening, emulator, joined, listening, ready, tcp_url, until
from tests.support.transports import modbus_pty_url, modbus_socket_url, modbus_tcp_url, pty_url, serial_socket_url

pytestmark = pytest.mark.live

NEW_URLS = {
    "canopen": tcp_url, "modbus-tcp": modbus_tcp_url, "modbus-pty": modbus_pty_url, "modbus-socket": modbus_socket_url,
    "uart-pty": pty_url, "uart-socket": serial_socket_url,
}


@pytest.fixture
def urls() -> dict[str, str]:
    """Where a drive can be, over every transport."""
    return {name: new() for name, new in NEW_URLS.items()}


def at(urls: dict[str, str]) -> list[str]:
    return [part for url in urls.values() for part in ("--at", url)]


@contextlib.contextmanager
def service_over(urls: dict[str, str]) -> Generator[Service]:
    """The real service, with a drive for every link; all stream."""
    with Service(Config(tuple(DriveConfig(name, url, Window()) for name, url in urls.items()))) as service:
        streaming(service)
        yield service


def streaming(service: Service) -> dict[str, Link]:
    """All links, when rows come over each again."""
    before = {name: service.link(name).rows for name in service.drives}

    def rows_come() -> bool:
        links = {name: service.link(name) for name in service.drives}
        return all(link.state is LinkState.STREAMING and link.rows > before[name] + 50 for name, link in links.items())

    until(rows_come, "rows over every link")
    until(service.healthy, "health")
    return {name: service.link(name) for name in service.drives}


def lost(service: Service, reconnects: int = 0) -> dict[str, str]:
    """What is said of every link, when each has been lost once more."""
    def told() -> bool:
        links = [service.link(name) for name in service.drives]
        return all(link.state is LinkState.LOST or link.reconnects > reconnects for link in links)

    until(told, "every link to be lost")
    return {name: error.sentence for name in service.drives if (error := service.link(name).last_error) is not None}


def reset_over_can(url: str) -> None:
    """An NMT command, from a tool of another make."""
    place = parse_can_url(url)
    network = canopen.Network()
    network.NOTIFIER_CYCLE = 0.02
    network.connect(interface="socketcand", host=place.host, port=place.port, channel=place.channel)
    network.send_message(od.NMT_COB_ID, bytes([od.NMT_RESET_NODE, place.node_id]))
    network.disconnect()


def of_every_link(listeners: dict[str, Listening]) -> set[int]:
    """Ticks of rows that have come over each."""
    return set[int].intersection(*(set(joined(each.blocks, "tick").tolist()) for each in listeners.values()))


def test_one_drive_is_the_same_over_every_link_at_once(urls: dict[str, str]) -> None:
    with command("emulate", *at(urls), "--control", "watchdog") as process:
        assert ready(process) == f"emulated drive 'paper' is at {' and '.join(urls.values())}\n"
        with contextlib.ExitStack() as stack:
            drives: dict[str, Drive] = {name: stack.enter_context(connect(url)) for name, url in urls.items()}
            for k, drive in enumerate(drives.values()):
                drive.write("i_q_ref", 0.5 + k / 8.0)
                assert {other.read("i_q_ref") for other in drives.values()} == {0.5 + k / 8.0}
            listeners = {name: stack.enter_context(listening(drive)) for name, drive in drives.items()}
            until(lambda: len(of_every_link(listeners)) > 300, "the same rows over every link")
    for name, listener in listeners.items():
        assert [block.lost_before for block in listener.blocks if block.lost_before] == [], name
    values = [
        dict(zip(joined(listener.blocks, "tick").tolist(), joined(listener.blocks, "u_q").tolist(), strict=True))
        for listener in listeners.values()
    ]
    common = of_every_link(listeners)
    assert all(len({value[tick] for value in values}) == 1 for tick in common)


def test_the_service_streams_again_after_a_reset_and_after_the_drives_death(urls: dict[str, str]) -> None:
    with emulator(*at(urls)) as process, contextlib.ExitStack() as stack:
        ready(process)
        service = stack.enter_context(service_over(urls))
        reset_over_can(urls["canopen"])
        sentences = lost(service)
        assert all("has reset" in sentence for sentence in sentences.values()), sentences
        links = streaming(service)
        assert {(link.reconnects, link.clock_resets) for link in links.values()} == {(1, 1)}
        assert all(link.gaps >= 1 for link in links.values())
        assert all(link.rows_lost > 0 for link in links.values())  # those that it made since
        process.kill()
        process.wait()
        lost(service, 1)
        with emulator(*at(urls)) as successor:
            ready(successor)
            links = streaming(service)
            assert {link.reconnects for link in links.values()} == {2}
            assert all(service.estimates(name).result.samples > 0 for name in urls)
            service = stack.pop_all()
            service.close()


def test_the_service_rebuilds_every_link_that_was_unplugged_and_counts_what_it_missed(
    urls: dict[str, str], capfd: pytest.CaptureFixture[str]
) -> None:
    with driving(*urls.values()) as running, service_over(urls) as service:
        running.spoil("unplugged")
        lost(service)
        tick = running.drive.tick
        until(lambda: running.drive.tick > tick + 5000, "its time stands still")
        running.spoil()
        links = streaming(service)
        assert {link.reconnects for link in links.values()} == {1}
        assert all(link.gaps >= 1 for link in links.values())  # more where a line that was held up skipped old rows
        assert all(link.rows_lost > 500 for link in links.values())
    assert capfd.readouterr().err == ""


def test_refusals_and_resets_of_a_script_reach_every_link(urls: dict[str, str], tmp_path: Path) -> None:
    script = tmp_path / "faults"
    resets = "".join(f"reset@{t}\n" for t in range(3, 18, 3))  # one of them comes while all are connected
    script.write_text(f"refuse=0x2200@0.5  # parameters\nlate=0.01\nnoise=0.0001\n{resets}")
    with emulator(*at(urls), "--fault-script", str(script)) as process:
        ready(process)
        with contextlib.ExitStack() as stack:
            drives = {name: stack.enter_context(connect(url)) for name, url in urls.items()}
            for name, drive in drives.items():
                until(lambda drive=drive: refused(drive), f"no refusal over {name}")
            ticks = dict.fromkeys(drives, 0.0)
            reset = set[str]()

            def all_reset() -> bool:
                for name, drive in drives.items():
                    with contextlib.suppress(DriveError):
                        assert drive.read("u_full") == 387.5
                        before, ticks[name] = ticks[name], drive.read("tick")
                        reset.update([name] if ticks[name] < before else [])
                return len(reset) == len(drives)

            until(all_reset, "a reset over every link")


def refused(drive: Drive) -> bool:
    """Whether parameters are refused, by index or register and code."""
    try:
        drive.read("bandwidth")
    except RefusedError as error:
        assert "bandwidth" in str(error)
        assert error.code in (od.Abort.GENERAL, 6)
        return True
    except DriveError:  # late
        return False
    return False


def test_a_stop_under_one_name_of_a_drive_ends_what_begins_under_another(urls: dict[str, str]) -> None:
    two = {name: urls[name] for name in ("canopen", "modbus-tcp")}
    holds = [{"speed_rpm": 1200.0, "i_d": 0.0, "i_q": 2.0, "seconds": 2.0}]

    def start(service: Service) -> threading.Thread:
        def begun() -> None:
            with contextlib.suppress(BenchError, DriveError):
                service.start_drive("canopen", {"i_q_ref": 2.0})

        thread = threading.Thread(target=begun)
        thread.start()
        until(lambda: service.control("canopen").whom is not None, "control to be taken")
        return thread

    def experiment(service: Service) -> threading.Thread:
        service.begin_experiment("canopen", {"holds": holds, "step": 0.5})
        thread = threading.Thread(target=lambda: until(lambda: not service.experiments.holders, "its end"))
        thread.start()
        return thread

    with command("emulate", *at(two), "--control", "lease") as process:
        ready(process)
        with service_over(two) as service, connect(two["modbus-tcp"]) as drive:
            for begin, later in itertools.product((start, experiment), (0.0, 0.01, 0.03, 0.06)):
                thread = begin(service)
                time.sleep(later)
                service.stop_drive("modbus-tcp")
                deadline, states = time.monotonic() + 0.4, set[State]()
                while time.monotonic() < deadline:
                    states.add(operation.state(drive))
                thread.join()
                assert states == {State.SWITCH_ON_DISABLED}, (begin.__name__, later)
