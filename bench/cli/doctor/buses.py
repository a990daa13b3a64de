"""The way to each drive, as far as it can be seen without being on its bus: nothing is sent, no device is opened.

A TCP port is connected to, and left, where that is harmless: where the service, or another program here, has it
already, it is not, since gateways may take one client only.
"""

import grp
import json
import os
import shutil
import socket
import stat
import subprocess
from collections.abc import Generator
from pathlib import Path
from typing import Any, Final, cast

from bench.cli.doctor import processes
from bench.cli.doctor.check import Check, failed, ok, warning
from bench.cli.doctor.running import Running, link_check
from bench.config import Config
from drivers.canopen.bus import check_interface
from drivers.errors import ConnectError
from drivers.wire.can_url import CanUrl, parse_can_url
from drivers.wire.modbus_url import TcpPlace, parse_modbus_url
from drivers.wire.uart_url import parse_uart_url

_TIMEOUT: Final = 2.0  # s to connect
_NET: Final = Path("/sys/class/net")
_CAN: Final = "280"  # ARPHRD_CAN
_UP: Final = 1  # IFF_UP
_SLOW: Final = 500_000  # bit/s
_FAULTS: Final = ("ERROR-PASSIVE", "BUS-OFF", "STOPPED")
_OVER_TCP: Final = ("socket", "rfc2217")


def checks(config: Config, running: Running | None) -> Generator[Check]:
    """The bus of each drive."""
    for drive in config.drives:
        what = f"drive {drive.name}"
        if running is not None and drive.url in running.drives:
            yield link_check(what, running.drives[drive.url])
        else:
            yield from _bus(what, drive.url)


def _bus(what: str, url: str) -> Generator[Check]:
    if url.startswith("canopen://"):
        yield from _can(what, parse_can_url(url))
    elif url.startswith("uart://"):
        uart = parse_uart_url(url)
        yield _serial(what, uart.device) if uart.device else _tcp(what, uart.host, uart.port)
    else:
        place = parse_modbus_url(url).place
        yield _tcp(what, place.host, place.port) if isinstance(place, TcpPlace) else _line(what, place.device)


def _line(what: str, device: str) -> Check:
    """A serial device, or one behind a TCP port, as pyserial addresses it."""
    protocol, over, address = device.partition("://")
    host, _, port = address.partition("?")[0].partition("/")[0].rpartition(":")
    if over and protocol in _OVER_TCP and port.isdecimal():
        return _tcp(what, host, int(port))
    return ok(what, f"{device}: an address of the serial library, which is not looked at") if over else _serial(
        what, device
    )


def _can(what: str, url: CanUrl) -> Generator[Check]:
    try:
        check_interface(url.interface)
    except ConnectError as error:
        yield failed(what, str(error), "install what python-can asks for of it, or use another interface")
        return
    if url.host is not None:
        yield _tcp(what, url.host, url.port or 0, many=True)
    elif url.interface == "socketcan":
        yield _socketcan(what, url.channel)
    elif url.channel.startswith("/"):
        yield _serial(what, url.channel)
    else:
        yield ok(what, f"python-can has {url.interface}; its channel {url.channel} is not looked at")


def _socketcan(what: str, name: str) -> Check:
    """A CAN interface of the kernel: there, up, how fast, and in which state."""
    there, bring_up = _NET / name, f"sudo ip link set {name} up type can bitrate 1000000"
    try:
        kind, flags = (there / "type").read_text().strip(), int((there / "flags").read_text(), 16)
    except (OSError, ValueError):
        found = ", ".join(sorted(p.name for p in _NET.glob("*") if _is_can(p))) or "none"
        return failed(what, f"no interface {name}; CAN interfaces here: {found}", f"plug its adapter in; {bring_up}")
    if kind != _CAN:
        return failed(what, f"{name} is an interface, but not of CAN", "name a CAN interface in its url")
    if not flags & _UP:
        return failed(what, f"{name} is down", bring_up)
    told = _told_by_ip(name)
    rate, state = told.get("bittiming", {}).get("bitrate"), str(told.get("state", ""))
    found = f"{name} is up" + (f", {rate} bit/s" if rate else "") + (f", {state}" if state else "")
    if state in _FAULTS:
        return warning(what, found, "nobody acknowledges, or at another bit rate: see drive, termination, bit rate")
    if rate and rate < _SLOW:
        return warning(what, found, "a slow bus carries few rows: use 500 kbit/s or 1 Mbit/s where the drive can")
    return ok(what, found)


def _is_can(interface: Path) -> bool:
    try:
        return (interface / "type").read_text().strip() == _CAN
    except OSError:
        return False


def _told_by_ip(name: str) -> dict[str, Any]:
    """Bit timing and state, where `ip` is here and tells them."""
    ip = shutil.which("ip")
    if ip is None:
        return {}
    try:
        said = subprocess.run(
            [ip, "-details", "-json", "link", "show", name], capture_output=True, timeout=_TIMEOUT, check=True
        ).stdout
        return cast(dict[str, Any], json.loads(said)[0]["linkinfo"]["info_data"])
    except (OSError, subprocess.SubprocessError, ValueError, LookupError, TypeError):
        return {}


def _serial(what: str, device: str) -> Check:
    """A serial device: there, permitted, nobody else's. It is not opened, which would move its control lines."""
    if not device.startswith("/"):
        return ok(what, f"{device}: a port by name, which is not looked at")
    path = Path(device)
    try:
        told = path.stat()
    except OSError as error:
        named = ", ".join(sorted(str(p) for k in ("ttyUSB*", "ttyACM*") for p in Path("/dev").glob(k))) or "none"
        return failed(
            what, f"{device}: {error.strerror}; serial adapters here: {named}",
            "plug it in, or name another in its url; /dev/serial/by-id has names that stay",
        )
    if not stat.S_ISCHR(told.st_mode):
        return failed(what, f"{device} is no device", "name a serial device in its url")
    if not os.access(path, os.R_OK | os.W_OK):
        group = _group(told.st_gid)
        return failed(
            what, f"{device} may not be opened by this user; its group is {group}",
            f"sudo usermod --append --groups {group} $USER, and log in again",
        )
    if who := processes.holder(path):
        return warning(what, f"{device} is open in {who}", "end that before the service starts")
    return ok(what, f"{device} is there and permitted")


def _group(number: int) -> str:
    try:
        return grp.getgrgid(number).gr_name
    except KeyError:
        return str(number)


def _tcp(what: str, host: str, port: int, *, many: bool = False) -> Check:
    """A TCP port: does it take a connection? `many`: it serves several clients at once."""
    try:
        addresses = {str(found[4][0]) for found in socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)}
    except OSError as error:
        return failed(what, f"{host}: {error.strerror or error}", "see the name in its url, and this machine's network")
    if not many and (who := processes.connected(addresses, port)):
        which = "a program here" if who == "one" else who
        return ok(what, f"{which} is connected to {host}:{port}, which is not asked a second time")
    try:
        with socket.create_connection((host, port), _TIMEOUT):
            return ok(what, f"{host}:{port} takes connections")
    except OSError as error:
        return failed(
            what, f"{host}:{port}: {error.strerror or error}", "switch drive or gateway on; see address, port, firewall"
        )
