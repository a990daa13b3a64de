"""What the service runs: drives, their windows, where it listens. From TOML or built in.

    [service]
    host = "127.0.0.1"
    port = 8080                                       # PMSM_BENCH_PORT has the last word
    captures = "captures"                             # folder of recordings, beside this file
    keep_free_megabytes = 200                         # of its disk, which recordings leave for others
    database = "catalogue.sqlite"                     # of what is remembered, or postgresql://user:password@host/name;
                                                      # PMSM_BENCH_DATABASE has the last word
    journals = "journals"                             # folder of what is flashed, was cut, or has to be undone
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
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Final

from pydantic import AfterValidator, BeforeValidator, Field, StringConstraints, TypeAdapter, ValidationInfo

from bench.actions.safety.limits import Limits
from bench.errors import ConfigError, LimitError, shown
from bench.expected import Else, Number, Table, taken, told
from bench.files import captures_folder, catalogue_file, journals_folder, log_folder, token_file
from bench.live.window import Window
from bench.machine_file import Nominal, load_machine, load_toml
from bench.store.catalogue.database import check_address
from drivers.connect import check_url
from drivers.errors import ConnectError

PORT: Final = 8080
PORT_VARIABLE: Final = "PMSM_BENCH_PORT"
DATABASE_VARIABLE: Final = "PMSM_BENCH_DATABASE"
_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")
_HOST: Final = r"^([A-Za-z0-9_][A-Za-z0-9_.-]*|\[[0-9A-Fa-f:.]+\])(:[0-9]{1,5})?$"


def _beside(value: object, info: ValidationInfo) -> Path | None:
    """A path as the file means it; None where it can be none."""
    return Path(str(info.context), value) if isinstance(value, str) and value and "\0" not in value else None


def _folder(value: object, info: ValidationInfo) -> object:
    folder = _beside(value, info)
    if folder is not None:
        there = next(place for place in (folder, *folder.parents) if os.path.lexists(place))  # the rest can be made
        if not there.is_dir():
            raise told("expected a folder", f", got {shown(value)}; {there} is none")
    return folder


def _database(value: object, info: ValidationInfo) -> str:
    """A file as the configuration means it, or the address of a PostgreSQL."""
    if not isinstance(value, str) or not value or "\0" in value:
        raise told("expected a file, or postgresql://user:password@host/name")
    try:
        check_address(value)
    except ConfigError as error:
        raise told(str(error), "") from None
    return value if "://" in value or info.context is None else str(Path(str(info.context), value))


def _url(url: str) -> str:
    try:
        check_url(url)
    except ConnectError as error:
        raise told(str(error), "") from None
    return url


_File = Annotated[Path, BeforeValidator(_beside), Else("expected a file name")]
_Folder = Annotated[Path, BeforeValidator(_folder), Else("expected a folder")]
_Port = Annotated[int, Field(strict=True, ge=0, le=65535), Else("expected a port of 0 to 65535")]
_NAMES: Final = Else('expected a list such as ["bench.lan", "localhost:9000"]')
_Name = Annotated[str, StringConstraints(pattern=_HOST, to_lower=True), _NAMES]
_Limit = Annotated[float, Number(1e-3, 1e6)]
_UNKNOWN: Final = "unknown key {key}, expected one of {all}"


@dataclass(frozen=True, slots=True)
class DriveConfig:
    """One drive: its name in the REST interface, its address, the window it starts with."""

    name: str
    url: str
    window: Window
    nominal: Nominal = field(default_factory=lambda: Nominal({}))  # what its machine file says
    limits: Limits = field(default_factory=Limits)  # of its set points


@dataclass(frozen=True, slots=True, kw_only=True)
class ServiceConfig:
    """The table [service]."""

    captures: _Folder = field(default_factory=captures_folder)
    certificate: _File | None = None  # PEM, with its key
    database: Annotated[str, BeforeValidator(_database)] = ""  # of what is remembered; empty: nothing is
    host: Annotated[str, Field(min_length=1), Else("expected an address")] = "127.0.0.1"
    insecure: Annotated[bool, Field(strict=True), Else("expected true or false")] = False  # beyond loopback without TLS
    journals: _Folder = field(default_factory=journals_folder)  # of what is flashed
    keep_free_megabytes: Annotated[float, Number(0.0, 1e9)] = 200.0  # of the disk, which recordings leave for others
    key: _File | None = None
    log: _Folder = field(default_factory=log_folder)
    names: Annotated[tuple[_Name, ...], _NAMES] = ()  # that it also has in addresses, with or without a port
    port: _Port = PORT
    token: _File = field(default_factory=token_file)


@dataclass(frozen=True, slots=True)
class Config(ServiceConfig):
    """The whole service."""

    drives: tuple[DriveConfig, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class _DriveTable:
    """A table [drives.NAME]."""

    limits: Annotated[
        Mapping[str, float],
        Table("expected a table limits", _UNKNOWN, {"i_max": _Limit, "speed_max_rpm": _Limit}, above=True),
    ] = field(default_factory=dict[str, float])
    machine: _File | None = None
    url: Annotated[str, Else('expected url = "canopen://..."', above=True), AfterValidator(_url)]
    window: Annotated[dict[str, object], Else("expected a table window", above=True)] = field(
        default_factory=dict[str, object]
    )


_ROOT: Final = TypeAdapter(Annotated[Mapping[str, dict[str, object]], Table("", _UNKNOWN, {
    "drives": Annotated[
        dict[str, object], Field(min_length=1),
        Else("expected a table drives", "expected at least one table [drives.NAME]", above=True),
    ],
    "service": Annotated[dict[str, object], Else("expected a table service", above=True)],
})])
_SERVICE: Final = TypeAdapter(Annotated[ServiceConfig, Table("", _UNKNOWN)])
_PORT: Final = TypeAdapter[int](_Port)
_DATABASE: Final = TypeAdapter[str](Annotated[str, BeforeValidator(_database)])


def emulated(url: str) -> Config:
    """The built-in configuration: one drive called `emulated`, of which nothing is known yet."""
    return Config((drive_of("emulated", url, Nominal({}), {}),), port=usual_port(), database=_database_of(""))


def drive_of(name: str, url: str, nominal: Nominal, limits: Mapping[str, float]) -> DriveConfig:
    """A drive by its machine's data: they are held, and bound its set points where `limits` say nothing else."""
    return DriveConfig(name, url, Window(held=nominal.given), nominal, _limits(name, nominal, limits))


def usual_database() -> str:
    """Of what is remembered, where no configuration says it. Raises ConfigError."""
    return _database_of("")


def usual_port() -> int:
    """The service's port where nothing else says it. Raises ConfigError."""
    port = _port_of_environment()
    return PORT if port is None else port


def load_config(path: Path) -> Config:
    """Read a configuration file. Raises ConfigError."""
    tables = taken(_ROOT, {"drives": {}, **load_toml(path)}, f"{path}:", ConfigError)
    given, port = tables.get("service", {}), _port_of_environment()
    where = f"{path}: [service]"
    service = taken(_SERVICE, given if port is None else given | {"port": port}, where, ConfigError, path.parent)
    if (service.certificate is None) != (service.key is None):
        there = "certificate" if service.key is None else "key"
        raise ConfigError(f"{where}: expected certificate and key, or neither, got {there} alone")
    service = replace(service, database=_database_of(service.database))
    drives = tuple(_drive(name, table, path) for name, table in tables["drives"].items())
    named: dict[str, str] = {}
    for drive in drives:  # two clients of one node would end each other's stream
        if (other := named.setdefault(drive.url, drive.name)) != drive.name:
            raise ConfigError(f"{path}: [drives.{drive.name}] url: expected one of its own, got that of {other}")
    return Config(drives, **{f.name: getattr(service, f.name) for f in fields(service)})


def _drive(name: str, given: object, path: Path) -> DriveConfig:
    if not _NAME.fullmatch(name):
        raise ConfigError(
            f"{path}: [drives]: expected names of letters, digits, '_', '.' and '-' that start with a letter or digit, "
            f"got {shown(name)}"
        )
    where = f"{path}: [drives.{name}]"
    kind = TypeAdapter(Annotated[_DriveTable, Table(f"expected a table {name}", _UNKNOWN)])
    table = taken(kind, given, where, ConfigError, path.parent)
    nominal = Nominal({}) if table.machine is None else load_machine(table.machine)
    drive = drive_of(name, table.url, nominal, table.limits)
    try:
        return replace(drive, window=drive.window.changed(table.window))
    except LimitError as error:
        raise ConfigError(f"{where} window: {error}") from None


def _limits(name: str, nominal: Nominal, given: Mapping[str, float]) -> Limits:
    return Limits(
        given.get("i_max", nominal.i_rated), given.get("speed_max_rpm", nominal.speed_max_rpm),
        raised_by=f"the configuration's [drives.{name}.limits]", n_p=nominal.n_p,
    )


def _database_of(configured: str) -> str:
    """The environment's, else the configured one, else that among the user's data."""
    text = os.environ.get(DATABASE_VARIABLE)
    if text is None:
        return configured or str(catalogue_file())
    return taken(_DATABASE, text, f"environment variable {DATABASE_VARIABLE}", ConfigError)


def _port_of_environment() -> int | None:
    text = os.environ.get(PORT_VARIABLE)
    if text is None:
        return None
    port = int(text) if re.fullmatch("[0-9]{1,9}", text) else text
    return taken(_PORT, port, f"environment variable {PORT_VARIABLE}", ConfigError)
