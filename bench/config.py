"""What the service runs: drives, their windows, where it listens. From TOML or built in.

    [service]
    host = "127.0.0.1"
    port = 8080                                       # PMSM_BENCH_PORT has the last word
    captures = "captures"                             # folder of captures, beside this file
    log = "log"                                       # folder of the logs of writes and of refusals
    names = ["bench.lan", "localhost:9000"]           # it is also called so in addresses; without a port: at its own
    certificate = "bench.pem"                         # TLS, with its key; needed beyond loopback,
    key = "bench.key"
    insecure = false                                  # unless this is true
    token = "token"                                   # file of what is asked of everybody beyond loopback

    [drives.spindle]
    url = "canopen://socketcan/can0/5"
    machine = "spindle.toml"                          # nominal values, beside this file; optional

    [drives.spindle.limits]                           # of set points, where the machine file's are not wanted
    i_max = 9.0                                       # A, of the current vector; else its i_rated
    speed_max_rpm = 4500.0                            # rpm; else its speed_max_rpm

    [drives.spindle.window]
    method = "wls"                                    # window; "rls" recursion; "ekf" Kalman filter
    length = 1000                                     # samples; "auto": each parameter's own, chosen by the data
    longest = 10000                                   # samples, with length = "auto"
    periods_per_row = 1
    estimated = ["R_s", "L_d", "L_q", "psi_f"]
    held = {psi_f = 0.12}                             # SI; what it leaves out comes from the nominal machine
    forgetting_factor = 1.0                           # rls: 0.99 to 1 = nothing is forgotten
    ekf = {preset = "tuned", noise_i = 0.01}          # or "paper", "custom": see bench/live/tuning.py

What is not understood is refused in a sentence that names file and key.
"""

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, cast

from bench.actions.limits import Limits
from bench.errors import ConfigError, LimitError, shown
from bench.live.tuning import number
from bench.live.window import Window
from bench.machine_file import Nominal, load_machine, load_toml
from drivers.connect import check_url
from drivers.errors import ConnectError

PORT_VARIABLE: Final = "PMSM_BENCH_PORT"
_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")


_SERVICE: Final = {"host", "port", "captures", "log", "token", "names", "certificate", "key", "insecure"}
_HOST: Final = re.compile(r"([A-Za-z0-9_][A-Za-z0-9_.-]*|\[[0-9A-Fa-f:.]+\])(:[0-9]{1,5})?")


def data_folder() -> Path:
    """Where the bench keeps things unless the configuration says otherwise: among the user's data, as XDG has it."""
    home = os.environ.get("XDG_DATA_HOME")
    return (Path(home) if home else Path.home() / ".local" / "share") / "pmsm-bench"


def captures_folder() -> Path:
    """Of captures."""
    return data_folder() / "captures"


def log_folder() -> Path:
    """Of what was written and what was refused."""
    return data_folder() / "log"


def token_file() -> Path:
    """Of the token that is asked for beyond loopback."""
    return data_folder() / "token"


@dataclass(frozen=True, slots=True)
class DriveConfig:
    """One drive: its name in the REST interface, its address, the window it starts with."""

    name: str
    url: str
    window: Window
    nominal: Nominal = field(default_factory=lambda: Nominal({}))  # what its machine file says
    limits: Limits = field(default_factory=Limits)  # of its set points


@dataclass(frozen=True, slots=True)
class Config:
    """The whole service."""

    drives: tuple[DriveConfig, ...]
    host: str = "127.0.0.1"
    port: int = 8080
    captures: Path = field(default_factory=captures_folder)
    log: Path = field(default_factory=log_folder)
    token: Path = field(default_factory=token_file)
    names: tuple[str, ...] = ()  # that it also has in addresses, in small letters, with or without a port
    certificate: Path | None = None  # PEM, with its key
    key: Path | None = None
    insecure: bool = False  # beyond loopback without TLS


def emulated(url: str, *, bounded: bool = True) -> Config:
    """The built-in configuration: one drive called `emulated`, with the nameplate of the emulated motor.

    `bounded`: its set points are, by that; the drive's own limits hold in any case.
    """
    held = {"R_s": 0.9664, "L_d": 4.24e-3, "L_q": 6.21e-3, "psi_f": 0.12}  # ohm, H, H, Vs
    nominal = Nominal(held, n_p=4, i_rated=6.0, speed_max_rpm=3000.0)
    limits = Limits(nominal.i_rated, nominal.speed_max_rpm, n_p=nominal.n_p) if bounded else Limits()
    drive = DriveConfig("emulated", url, Window(held=held), nominal, limits)
    return Config((drive,), port=_port({}, "built-in configuration"))


def load_config(path: Path) -> Config:
    """Read a configuration file. Raises ConfigError."""
    content = load_toml(path)
    _known(content, {"service", "drives"}, str(path))
    service = _table(content, "service", str(path))
    _known(service, _SERVICE, f"{path}: [service]")
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
    return Config(
        drives, host, _port(service, str(path)), _folder(service, "captures", captures_folder(), path),
        _folder(service, "log", log_folder(), path), _file(service, "token", path) or token_file(),
        _names(service, str(path)), *_tls(service, path), _insecure(service, str(path)),
    )  # fmt: skip


def _drive(name: str, tables: Mapping[str, Any], path: Path) -> DriveConfig:
    if not _NAME.fullmatch(name):
        raise ConfigError(
            f"{path}: [drives]: expected names of letters, digits, '_', '.' and '-' that start with a letter or digit, "
            f"got {shown(name)}"
        )
    where = f"{path}: [drives.{name}]"
    table = _table(tables, name, where)
    _known(table, {"url", "machine", "limits", "window"}, where)
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
    return DriveConfig(name, url, window, nominal, _limits(table, nominal, name, where))


def _limits(table: Mapping[str, Any], nominal: Nominal, name: str, where: str) -> Limits:
    given = _table(table, "limits", where)
    values: dict[str, float | None] = {"i_max": nominal.i_rated, "speed_max_rpm": nominal.speed_max_rpm}
    _known(given, set(values), f"{where} limits")
    for key, value in given.items():
        try:
            values[key] = number(f"{where} limits {key}", value, 1e-3, 1e6)
        except LimitError as error:
            raise ConfigError(str(error)) from None
    return Limits(**values, raised_by=f"the configuration's [drives.{name}.limits]", n_p=nominal.n_p)


def _folder(service: Mapping[str, Any], key: str, usual: Path, path: Path) -> Path:
    given = service.get(key, str(usual))
    if not isinstance(given, str) or not given:
        raise ConfigError(f"{path}: [service] {key}: expected a folder, got {shown(given)}")
    folder = path.parent / given
    there = next(place for place in (folder, *folder.parents) if os.path.lexists(place))  # the rest can be made
    if not there.is_dir():
        raise ConfigError(f"{path}: [service] {key}: expected a folder, got {shown(given)}; {there} is none")
    return folder


def _file(service: Mapping[str, Any], key: str, path: Path) -> Path | None:
    if key not in service:
        return None
    given = service[key]
    if not isinstance(given, str) or not given or "\0" in given:
        raise ConfigError(f"{path}: [service] {key}: expected a file name, got {shown(given)}")
    return path.parent / given


def _names(service: Mapping[str, Any], where: str) -> tuple[str, ...]:
    given = service.get("names", [])
    names = cast(list[object], given) if isinstance(given, list) else [given]
    for name in names:
        if not isinstance(given, list) or not isinstance(name, str) or not _HOST.fullmatch(name):
            raise ConfigError(
                f'{where}: [service] names: expected a list such as ["bench.lan", "localhost:9000"], got {shown(name)}'
            )
    return tuple(str(name).lower() for name in names)


def _tls(service: Mapping[str, Any], path: Path) -> tuple[Path | None, Path | None]:
    certificate, key = _file(service, "certificate", path), _file(service, "key", path)
    if (certificate is None) != (key is None):
        there = "certificate" if key is None else "key"
        raise ConfigError(f"{path}: [service]: expected certificate and key, or neither, got {there} alone")
    return certificate, key


def _insecure(service: Mapping[str, Any], where: str) -> bool:
    value = service.get("insecure", False)
    if not isinstance(value, bool):
        raise ConfigError(f"{where}: [service] insecure: expected true or false, got {shown(value)}")
    return value


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
