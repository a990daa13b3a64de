"""What the service runs: drives, their windows, where it listens. From TOML or built in.

    [service]
    host = "127.0.0.1"
    port = 8080                                       # PMSM_BENCH_PORT has the last word
    captures = "captures"                             # folder of captures, beside this file

    [drives.spindle]
    url = "canopen://socketcan/can0/5"
    machine = "spindle.toml"                          # nominal values, beside this file; optional

    [drives.spindle.window]
    method = "wls"                                    # window; "rls" recursion; "ekf" Kalman filter
    length = 1000                                     # samples; "auto": each parameter's own, chosen by the data
    longest = 10000                                   # samples, with length = "auto"
    periods_per_row = 1
    estimated = ["R_s", "L_d", "L_q", "psi_f"]
    held = {psi_f = 0.12}                             # SI; what it leaves out comes from the nominal machine
    forgetting_factor = 1.0                           # rls: 0.99 to 1 = nothing is forgotten
    ekf = {preset = "tuned", noise_i = 0.01}          # or "paper", "custom": see bench/tuning.py

What is not understood is refused in a sentence that names file and key.
"""

import os
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, cast

from bench.errors import ConfigError, LimitError, shown
from bench.machine_file import Nominal, load_machine
from bench.window import Window
from drivers.connect import check_url
from drivers.errors import ConnectError

PORT_VARIABLE: Final = "PMSM_BENCH_PORT"
_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")


def captures_folder() -> Path:
    """Where captures go unless the configuration says otherwise: among the user's data, as XDG has it."""
    home = os.environ.get("XDG_DATA_HOME")
    return (Path(home) if home else Path.home() / ".local" / "share") / "pmsm-bench" / "captures"


@dataclass(frozen=True, slots=True)
class DriveConfig:
    """One drive: its name in the REST interface, its address, the window it starts with."""

    name: str
    url: str
    window: Window
    nominal: Nominal = field(default_factory=lambda: Nominal({}))  # what its machine file says


@dataclass(frozen=True, slots=True)
class Config:
    """The whole service."""

    drives: tuple[DriveConfig, ...]
    host: str = "127.0.0.1"
    port: int = 8080
    captures: Path = field(default_factory=captures_folder)


def emulated(url: str) -> Config:
    """The built-in configuration: one drive called `emulated`, with the nameplate of the emulated motor."""
    held = {"R_s": 0.9664, "L_d": 4.24e-3, "L_q": 6.21e-3, "psi_f": 0.12}  # ohm, H, H, Vs
    drive = DriveConfig("emulated", url, Window(held=held), Nominal(held, n_p=4, i_rated=6.0))
    return Config((drive,), port=_port({}, "built-in configuration"))


def load_config(path: Path) -> Config:
    """Read a configuration file. Raises ConfigError."""
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror or error}") from None
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: not TOML: {error}") from None
    except (RecursionError, ValueError) as error:  # brackets without end; a path, text or number that cannot be
        raise ConfigError(f"{path}: not TOML: {type(error).__name__}") from None
    _known(content, {"service", "drives"}, str(path))
    service = _table(content, "service", str(path))
    _known(service, {"host", "port", "captures"}, f"{path}: [service]")
    host = service.get("host", "127.0.0.1")
    if not isinstance(host, str) or not host:
        raise ConfigError(f"{path}: [service] host: expected an address, got {shown(host)}")
    tables = _table(content, "drives", str(path))
    if not tables:
        raise ConfigError(f"{path}: expected at least one table [drives.NAME], got none")
    drives = tuple(_drive(name, tables, path) for name in tables)
    named: dict[str, str] = {}
    for drive in drives:  # two clients of one node would end each other's stream
        if (other := named.setdefault(drive.url, drive.name)) != drive.name:
            raise ConfigError(f"{path}: [drives.{drive.name}] url: expected one of its own, got that of {other}")
    return Config(drives, host, _port(service, str(path)), _captures(service, path))


def _drive(name: str, tables: Mapping[str, Any], path: Path) -> DriveConfig:
    if not _NAME.fullmatch(name):
        raise ConfigError(
            f"{path}: [drives]: expected names of letters, digits, '_', '.' and '-' that start with a letter or digit, "
            f"got {shown(name)}"
        )
    where = f"{path}: [drives.{name}]"
    table = _table(tables, name, where)
    _known(table, {"url", "machine", "window"}, where)
    url = table.get("url")
    if not isinstance(url, str):
        raise ConfigError(f"{where}: expected url = \"canopen://...\", got {shown(url)}")
    try:
        check_url(url)
    except ConnectError as error:
        raise ConfigError(f"{where} url: {error}") from None
    nominal = Nominal({})
    if "machine" in table:
        if not isinstance(table["machine"], str):
            raise ConfigError(f"{where} machine: expected a file name, got {shown(table['machine'])}")
        nominal = load_machine(path.parent / table["machine"])
    try:
        window = Window(held=nominal.given).changed(_table(table, "window", where))
    except LimitError as error:
        raise ConfigError(f"{where} window: {error}") from None
    return DriveConfig(name, url, window, nominal)


def _captures(service: Mapping[str, Any], path: Path) -> Path:
    given = service.get("captures", str(captures_folder()))
    if not isinstance(given, str) or not given:
        raise ConfigError(f"{path}: [service] captures: expected a folder, got {shown(given)}")
    folder = path.parent / given
    there = next(place for place in (folder, *folder.parents) if os.path.lexists(place))  # the rest can be made
    if not there.is_dir():
        raise ConfigError(f"{path}: [service] captures: expected a folder, got {shown(given)}; {there} is none")
    return folder


def _port(service: Mapping[str, Any], where: str) -> int:
    text = os.environ.get(PORT_VARIABLE)
    where, value = f"{where}: [service] port", cast(object, service.get("port", 8080))
    if text is not None:
        where, value = f"environment variable {PORT_VARIABLE}", int(text) if re.fullmatch("[0-9]{1,9}", text) else text
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= 65535:
        raise ConfigError(f"{where}: expected a port of 0 to 65535, got {shown(value)}")
    return value


def _table(content: Mapping[str, Any], key: str, where: str) -> dict[str, Any]:
    value = content.get(key, {})
    if not isinstance(value, dict):
        raise ConfigError(f"{where}: expected a table {key}, got {shown(value)}")
    return cast(dict[str, Any], value)


def _known(table: Mapping[str, Any], known: set[str], where: str) -> None:
    for key in table:
        if key not in known:
            raise ConfigError(f"{where}: unknown key {shown(key)}, expected one of {', '.join(sorted(known))}")
