"""The links over loopback beside what their buses would allow: `python -m tests.bars.bench_links`.

Emulated drive, client and service are processes of their own; the processor time is the client's alone. A sample is one
row of the stream. Latency is the age, by the drive's clock, of the newest row that REST tells, asked at any moment.
Machines are noisy: the load average stands beside the figures.
"""

import argparse
import contextlib
import http.client
import json
import os
import random
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Generator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from drivers import capture
from drivers.connect import connect
from drivers.drive import Drive
from drivers.wire import canopen_od as od
from drivers.wire import modbus_map, uart_frame
from drivers.wire.dictionary import CAPTURE_SAMPLES
from tests.conftest import command, free_port, wait_for_answer
from tests.proof.results import record
from tests.support.served_drive import emulator, ready, tcp_url
from tests.support.transports import modbus_tcp_url, pty_url, serial_socket_url

CHANNELS: Final = ("theta_e", "i_d", "i_q", "omega_e", "u_d", "u_q")
CAN_FRAMES: Final = 8000.0  # 1/s, of 8 bytes with stuffing, on a bus of 1 Mbit/s
BAUD: Final = {"uart": 3_000_000, "modbus": 115_200}
ASKED: Final = 1000  # times, for a latency
BARS: Final = {"core": 0.5, "rest": 20e-3, "upload": 8.0}
REAL_TIME: Final = 0.99  # of the rows that real time asks for: fewer, and the emulated drive was held up


@dataclass(frozen=True, slots=True)
class Link:
    """A way to a drive, how fast it is to stream, and what its bus would allow."""

    name: str
    new_url: Callable[[], str]
    periods: int  # control periods per row
    bus: str
    bus_rows: float  # 1/s
    bus_upload: float  # s, of the longest recording of six signals
    T_s: float = 1e-4  # s, control period


@dataclass(frozen=True, slots=True)
class Streamed:
    """A stream, as its client saw it."""

    rows: int
    lost: int
    wall: float  # s
    cpu: float  # s, of the client's process

    @property
    def rate(self) -> float:
        """Rows per second."""
        return self.rows / self.wall


@dataclass(frozen=True, slots=True)
class Found:
    """What was measured of a link."""

    stream: Streamed
    upload: float  # s
    latency: tuple[float, float]  # s, of the newest row: median, 99 %


def links() -> list[Link]:
    """Every transport, over TCP and, where it is a serial line, over a pty."""
    can_rows = CAN_FRAMES / (od.ROW_TPDOS + 1.0 / od.SLOW_ROWS)
    upload = 2 * len(CHANNELS) * CAPTURE_SAMPLES  # bytes
    can_upload = upload / 7 * 128 / 127 / CAN_FRAMES
    byte = 10.0 / BAUD["uart"]  # s
    row = uart_frame.ROWS.size + uart_frame.ROWS_PER_FRAME * uart_frame.ROW_BYTES + 10  # with head, checksum, stuffing
    uart = (uart_frame.ROWS_PER_FRAME / row / byte, upload * 1.03 * byte)
    # A request of 21 bytes, an answer of 5 and its registers, 11 bits each, 1.75 ms of silence after both
    exchange = (26 + 2 * modbus_map.MOST_READ) * 11.0 / BAUD["modbus"] + 3.5e-3  # s
    rtu = (modbus_map.MOST_ROWS / exchange, upload / (2 * (modbus_map.MOST_REGISTERS - 2)) * exchange)
    packets = (188 + 2 * modbus_map.MOST_READ) * 8.0 / 100e6  # s, with Ethernet's, IP's and TCP's heads
    tcp = (modbus_map.MOST_ROWS / packets, upload / (2 * (modbus_map.MOST_REGISTERS - 2)) * packets)
    line = f"{tempfile.gettempdir()}/pmsm-bench-links-{os.getpid()}"
    return [
        Link("canopen socketcand", tcp_url, 3, "CAN, 1 Mbit/s", can_rows, can_upload, T_s=1.25e-4),
        Link("modbus tcp", modbus_tcp_url, 2, "100 Mbit/s", *tcp),
        Link("modbus rtu, pty", lambda: f"modbus+rtu://{line}?baudrate={BAUD['modbus']}/1", 2, "115,200 baud", *rtu),
        Link("uart, pty", pty_url, 1, "3 Mbaud", *uart),
        Link("uart, socket", serial_socket_url, 1, "3 Mbaud", *uart),
    ]


def main(arguments: list[str] | None = None) -> int:
    """Print the table. 0 when every bar is met."""
    parser = argparse.ArgumentParser("bench_links", description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="of every stream")
    parser.add_argument("--only", default="", help="links whose name has this in it")
    parser.add_argument("--client", nargs=2, help=argparse.SUPPRESS)  # URL, periods: be the client
    options = parser.parse_args(arguments)
    if options.client:
        url, periods = options.client
        print(json.dumps(measured(url, int(periods), options.seconds)))
        return 0
    good = list[bool]()

    def bar(text: str, met: bool) -> None:
        good.append(met)
        print(f"  {'met' if met else 'MISSED':6} {text}", flush=True)

    found = {link.name: one_link(link, options.seconds, bar) for link in links() if options.only in link.name}
    if options.only in "four drives":
        four_drives(options.seconds, bar)
    if not options.only:
        _recorded(*found.values())
    return 0 if all(good) else 1


def _recorded(can: Found, tcp: Found, rtu: Found, *uart: Found) -> None:
    every = (can, tcp, rtu, *uart)

    def cost(*of: Found) -> str:
        return " and ".join(f"{1e6 * each.stream.cpu / each.stream.rows:.0f}" for each in of)

    slowest = max(uart, key=lambda one: one.stream.cpu / one.stream.rows)
    record("service.rates", f"{can.stream.rate:,.0f}, {cost(can)} ms, {can.stream.cpu / can.stream.wall:.2f} cores; "
           f"{tcp.stream.rate:,.0f}, {cost(tcp, rtu)} ms; {slowest.stream.rate:,.0f}, {cost(slowest)} ms")  # fmt: skip
    uploads = (can.upload, tcp.upload, rtu.upload, max(one.upload for one in uart))
    record("service.uploads", f"{', '.join(f'{upload:.2g}' for upload in uploads)} s")
    median, p99 = (max(one.latency[k] for one in every) for k in range(2))
    record("service.latency", f"{median * 1e3:.0f} ms, {p99 * 1e3:.0f} ms", p99 <= BARS["rest"])


def one_link(link: Link, seconds: float, bar: Callable[[str, bool], None]) -> Found:
    """Stream, upload and latency of one link."""
    wanted = 1.0 / (link.periods * link.T_s)
    with emulated(link.T_s, url := link.new_url()):
        told = subprocess.run(
            [sys.executable, "-m", "tests.bars.bench_links", "--client", url, str(link.periods), "--seconds",
             str(seconds)],
            stdout=subprocess.PIPE, text=True, check=True,
        )
    client = json.loads(told.stdout)
    stream, upload = Streamed(**client["stream"]), float(client["upload"])
    print(f"{link.name}, {stream.wall:.0f} s, load average {load()}")
    print(f"  {stream.rate:10,.0f} rows/s, {stream.lost} lost; {link.bus} would allow {link.bus_rows:,.0f}")
    print(f"  {1e6 * stream.cpu / stream.rows:10,.1f} ms of the client's processor per 1,000 rows, "
          f"{stream.cpu / stream.wall:.2f} cores")
    print(f"  {upload:10.2f} s for {CAPTURE_SAMPLES:,} x {len(CHANNELS)} samples, "
          f"{CAPTURE_SAMPLES * len(CHANNELS) / upload:,.0f} samples/s; {link.bus} would take {link.bus_upload:.1f}")
    with emulated(link.T_s, url := link.new_url(), clock := tcp_url()), service([url]) as (port, _):
        latency = told_latency(latencies(port, clock, link.T_s), bar)
    kept = stream.rate >= REAL_TIME * wanted
    lossless = f"no row lost at {wanted:,.0f} rows/s: {stream.lost} lost, {stream.rate:,.0f} rows/s"
    if link.name.startswith("canopen"):
        bar(f"{lossless}, {stream.rate * (od.ROW_TPDOS + 1 / od.SLOW_ROWS):,.0f} frames/s", kept and not stream.lost)
        cores = stream.cpu / stream.wall
        bar(f"at most {BARS['core']:g} cores in the client: {cores:.2f}", cores <= BARS["core"])
        bar(f"upload within {BARS['upload']:g} s: {upload:.2f}", upload <= BARS["upload"])
    else:
        bar(lossless, kept and not stream.lost)
    print()
    return Found(stream, upload, latency)


def four_drives(seconds: float, bar: Callable[[str, bool], None]) -> None:
    """Four drives at once through the real service."""
    with contextlib.ExitStack() as stack:
        urls, clock = [tcp_url() for _ in range(4)], tcp_url()
        for k, url in enumerate(urls):
            stack.enter_context(emulated(1e-4, url, *([] if k else [clock])))
        port, pid = stack.enter_context(service(urls))
        before, cpu, began = [asked(port, k)["stream"] for k in range(4)], processor_of(pid), time.monotonic()
        latency = latencies(port, clock, 1e-4)
        time.sleep(max(0.0, seconds - (time.monotonic() - began)))
        after = [asked(port, k)["stream"] for k in range(4)]
        cpu, wall = processor_of(pid) - cpu, time.monotonic() - began
        dropped = sum(asked(port, k, "/estimates")["rows_dropped"] for k in range(4))
    rates = [(late["rows"] - early["rows"]) / wall for early, late in zip(before, after, strict=True)]
    lost = sum(stream["rows_lost"] + stream["gaps"] for stream in after)
    print(f"four drives on canopen socketcand, {wall:.0f} s, load average {load()}")
    per_row = cpu / wall / sum(rates)
    print(f"  {1e6 * per_row:10,.1f} ms of the service's processor per 1,000 rows, {cpu / wall:.2f} cores")
    _, p99 = told_latency(latency, bar)
    record("service.four", f"{lost or 'none'}; {p99 * 1e3:.0f} ms", p99 <= BARS["rest"])
    bar(
        f"no row lost of four drives at 1,000 rows/s: {lost} lost, {dropped} dropped by the estimation, "
        f"{min(rates):,.0f} to {max(rates):,.0f} rows/s",
        not lost and not dropped and min(rates) >= REAL_TIME * 1000.0,
    )


def told_latency(latency: dict[str, list[float]], bar: Callable[[str, bool], None]) -> tuple[float, float]:
    """Print latencies; the bar is on the snapshot of the stream, whose median and 99 % (s) come back."""
    for what, found in latency.items():
        median, p99 = np.percentile(found, (50, 99)) * 1e3
        print(f"  {median:10.1f} ms from the drive's tick to REST, {what}, median; 99 % within {p99:.1f} ms")
    median, p99 = (float(each) for each in np.percentile(latency["newest row"], (50, 99)))
    bar(f"99 % within {BARS['rest'] * 1e3:g} ms from tick to REST: {p99 * 1e3:.1f} ms", p99 <= BARS["rest"])
    return median, p99


def measured(url: str, periods: int, seconds: float) -> dict[str, Any]:
    """What a client measures, in this process."""
    with connect(url) as drive:
        drive.write("stream_periods", periods)
        stream = streamed(drive, seconds)
        setup = capture.Setup(CHANNELS, CAPTURE_SAMPLES)
        capture.arm(drive, setup)
        under_way = capture.awaited(drive, setup, patience=60.0)
        began = time.monotonic()
        recording = capture.upload(drive, under_way)
        took = time.monotonic() - began
    assert all(len(column) == CAPTURE_SAMPLES for column in recording.columns.values())
    return {"stream": asdict(stream), "upload": took}


def streamed(drive: Drive, seconds: float) -> Streamed:
    """A stream from its first block on."""
    rows = lost = 0
    first = began = cpu = last = 0.0
    for block in drive.stream():
        now = time.monotonic()
        if not began:  # what came at once is of the time before
            began, cpu, first = now, processor(), int(block.tick[-1])
            continue
        rows, lost, last = rows + len(block), lost + block.lost_before, int(block.tick[-1])
        if now - began >= seconds:
            assert rows + lost == (last - first) // block.periods
            return Streamed(rows, lost, now - began, processor() - cpu)
    raise AssertionError("the stream has ended")


def processor() -> float:
    """Processor time of this process, s."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def processor_of(pid: int) -> float:
    """Processor time of a process, s."""
    user, system = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:13]
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


@contextlib.contextmanager
def emulated(T_s: float, *urls: str) -> Generator[None]:
    """The paper's drive with a control period in s, in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        scenario = Path(folder) / "scenario.toml"
        scenario.write_text(
            "[motor]\nR_s = 0.9664\nL_d = 4.24e-3\nL_q = 6.21e-3\npsi_f = 0.12\nn_p = 4\ni_rated = 6.0\n"
            f"[drive]\nT_s = {T_s}\n[excitation]\ni_q_ref = 2.0\ni_d_step = 3.0\ni_q_step = 3.0\n"
        )
        at = [option for url in urls for option in ("--at", url)]
        with emulator(*at, "--scenario", str(scenario)) as process:
            ready(process)
            yield


@contextlib.contextmanager
def service(urls: list[str]) -> Generator[tuple[int, int]]:
    """The service over drives called 0, 1 ..., streaming; its port and its process."""
    with tempfile.TemporaryDirectory() as folder:
        config, port = Path(folder) / "bench.toml", free_port()
        config.write_text("".join(f'[drives.{k}]\nurl = "{url}"\n' for k, url in enumerate(urls)))
        with command("serve", "--config", str(config), "--port", str(port)) as process:
            wait_for_answer(f"http://127.0.0.1:{port}/api/health", process)
            while any(not asked(port, k)["stream"]["rows"] for k in range(len(urls))):
                time.sleep(0.05)
            yield port, process.pid


def asked(port: int, drive: int, what: str = "") -> dict[str, Any]:
    """What REST tells of a drive."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10.0)
    with contextlib.closing(connection):
        connection.request("GET", f"/api/drives/{drive}{what}")
        return json.loads(connection.getresponse().read())


def latencies(port: int, clock: str, T_s: float) -> dict[str, list[float]]:
    """Age in s of the newest row, and of the newest estimates, of the first drive as the answer comes.

    `clock` is another way to that drive: asked often, it tells when its tick was zero, to within the time of a read.
    """
    ages: dict[str, list[float]] = {"newest row": [], "estimates": []}
    zero = began(clock, T_s)
    for _ in range(ASKED):
        time.sleep(random.uniform(0.02, 0.04))  # two requests: more than 100 a second are refused
        told = asked(port, 0)["stream"]["t_drive_s"]
        ages["newest row"].append(time.monotonic() - zero - told)
        told = asked(port, 0, "/estimates")["t_drive_s"]
        ages["estimates"].append(time.monotonic() - zero - told)
    return ages


def began(clock: str, T_s: float) -> float:
    """When a drive's tick was zero, s, monotonic."""
    zero = float("inf")
    with connect(clock) as drive:
        for _ in range(1000):
            tick = drive.read("tick")
            zero = min(zero, time.monotonic() - tick * T_s)
    return zero


def load() -> str:
    """The machine's load average of the last minute."""
    return f"{os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"


if __name__ == "__main__":
    sys.exit(main())
