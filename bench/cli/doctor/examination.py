"""All checks, in order: the machine, the configuration, its places, its port, the way to each drive."""

from collections.abc import Generator
from dataclasses import replace
from pathlib import Path

from bench.cli.doctor import buses, machine, places, running
from bench.cli.doctor.check import Check, failed, ok
from bench.config import Config, load_config, usual_port
from bench.errors import ConfigError


def examined(file: Path | None, port: int | None = None) -> Generator[Check]:
    """What can be said of a bench by a configuration file; without one of a service as `up` begins it."""
    yield from machine.checks()
    try:
        config = Config((), port=usual_port()) if file is None else load_config(file)
    except ConfigError as error:
        yield failed("configuration", str(error), "mend the file; what it names is checked then")
        return
    if port is not None:
        config = replace(config, port=port)
    if file is not None:
        names = ", ".join(drive.name for drive in config.drives)
        yield ok("configuration", f"{file}, with {names}")
    yield from places.checks(config)
    check, service = running.looked_at(config)
    yield check
    yield from buses.checks(config, service)
    for drive in service.drives.values() if service is not None and file is None else ():
        yield running.link_check(f"drive {drive['name']}", drive)
