"""Running things: the service, the emulated drive, both. The emulated drive is a process of its own, behind a bus."""

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Generator, Mapping
from concurrent.futures import wait
from dataclasses import replace
from functools import partial
from types import FrameType
from typing import TYPE_CHECKING, NoReturn

from bench.cli.output import in_thread
from bench.cli.terminal import Terminal, one_line
from bench.config import PORT, Config, drive_of, emulated, usual_port
from bench.errors import ConfigError
from bench.machine_file import nominal_of
from drivers.errors import FaultError, LostError
from drivers.lease import HeldError

if TYPE_CHECKING:
    from bench.service.service import Service

_READY_TIMEOUT = 600.0  # s, the first start compiles, which takes long beside other work
_END = 0.3  # s for the emulated drive to end before it is made to
_THREADS = 0.3  # s for those that answer requests, when all that they could wait for has ended
_LINKED = 10.0  # s for the service's link to its emulated drive
_BUS_PORT = 29536  # of the emulated drive beside a service at the usual port
_LISTENS = 0.2  # s, after which a signal is heard at the latest
_console = Terminal(soft_wrap=True)


def run_service(config: Config, port: int | None) -> None:
    """Serve until SIGINT or SIGTERM."""
    with _until_told(), _listening(config, port) as listener:
        _serve(config, listener)


def run_emulator(urls: list[str], scenario: str, faults: list[str]) -> int:
    """Become the emulated drive; `faults` are its options about them."""
    command = [*_emulator_command(urls, scenario), *faults]
    return subprocess.call(command) if os.name == "nt" else os.execv(sys.executable, command)


def run_both(url: str | None, scenario: str, port: int | None) -> None:
    """An emulated drive in a process of its own, and the service over it, which starts it with its set points."""
    config = emulated(url or _bus(usual_port() if port is None else port))
    with _until_told(), _listening(config, port) as listener, contextlib.ExitStack() as opened:
        (drive,) = config.drives
        with _console.status("preparing the emulated drive (compiles at the first start)"):
            sheet = opened.enter_context(_emulator(drive.url, scenario))
        nominal = nominal_of({"machine": sheet["machine"], "drive": sheet["drive"]}, f"scenario {scenario}")
        known = drive_of(drive.name, drive.url, nominal, sheet["limits"])
        _serve(replace(config, drives=(known,)), listener, sheet.get("set_points"))


def _bus(port: int) -> str:
    """Where the emulated drive of a service at a port is: as far from the usual place as that port; else at a free one.

    So each of several has its own, the same whenever it is started again.
    """
    beside = _BUS_PORT + port - PORT
    for place in ([beside] if 0 < beside < 1 << 16 else []) + [0]:
        with contextlib.suppress(OSError), socket.create_server(("127.0.0.1", place)) as free:
            return f"canopen://socketcand/127.0.0.1:{free.getsockname()[1]}/can0/5"
    raise ConfigError("no port of 127.0.0.1 is free for the emulated drive; `pmsm-bench up --at URL` puts it elsewhere")


class _Told:
    """Hears the first signal to end, as a KeyboardInterrupt; those after it do not interrupt what stops the drives."""

    def __init__(self) -> None:
        self._once = False

    def __call__(self, _number: int, _frame: FrameType | None) -> None:
        if not self._once:
            self._once = True
            raise KeyboardInterrupt


@contextlib.contextmanager
def _until_told() -> Generator[None]:
    """What runs inside ends in good order at Ctrl-C, SIGTERM or a closed terminal, which is no failure."""
    told = _Told()
    hang_up = getattr(signal, "SIGHUP", None)  # not on every system
    with contextlib.ExitStack() as handled:
        for number in (signal.SIGINT, signal.SIGTERM):
            handled.enter_context(_handling(number, told))
        if hang_up is not None and signal.getsignal(hang_up) is not signal.SIG_IGN:  # as by nohup
            handled.enter_context(_handling(hang_up, lambda _number, _frame: signal.raise_signal(signal.SIGTERM)))
        with contextlib.suppress(KeyboardInterrupt):
            yield
        _exit()


def _exit() -> NoReturn:
    """End with code 0, whatever thread a library has left; the interpreter would wait for it, and take itself apart."""
    until = time.monotonic() + _THREADS
    for thread in threading.enumerate():
        if not thread.daemon and thread is not threading.main_thread():
            thread.join(max(0.0, until - time.monotonic()))
    with contextlib.suppress(OSError, ValueError):  # nobody reads it
        sys.stdout.flush()
    os._exit(0)


@contextlib.contextmanager
def _handling(number: int, handler: Callable[[int, FrameType | None], object]) -> Generator[None]:
    before = signal.signal(number, handler)
    try:
        yield
    finally:
        signal.signal(number, before)


def _listening(config: Config, port: int | None) -> socket.socket:
    from bench.api.server import listen

    return listen(config.host, config.port if port is None else port)


def _serve(config: Config, listener: socket.socket, set_points: Mapping[str, float] | None = None) -> None:
    """Serve; drives are started with set points where there are any."""
    from bench.api.guard.access import access_to
    from bench.api.server import serve
    from bench.live.method import warm_up
    from bench.service.service import Service
    from bench.store.write_log import WriteLog, to_standard_error
    from estimator.diagnosis import watch

    host, port = listener.getsockname()[:2]
    access = access_to(config, host, port)
    with _console.status("preparing the estimator (compiles at the first start)"):
        meanwhile(warm_up)
        meanwhile(watch.warm_up)  # which the estimation would compile otherwise, and hear no signal
    with (
        contextlib.ExitStack() as ended, WriteLog(config.log, to_standard_error) as log,
        Service(replace(config, port=port)) as service,
    ):
        ended.callback(_tell_end, service)
        log.also = service.wrote
        root = access.address(host)
        _console.print(f"page   {root}/\nREST   {root}/api/drives   documentation {root}/docs")
        for drive in config.drives:
            _console.print(f"drive  {drive.name}: {drive.url}")
            if set_points is not None:
                meanwhile(partial(_started, service, drive.name, set_points))  # whole, or undone by the service's end
        _console.print(f"open   to {access.told()}\nCtrl-C ends it")
        serve(service, listener, access, log)


def _tell_end(service: "Service") -> None:
    with contextlib.suppress(OSError):  # nobody reads it
        print(*map(one_line, service.farewell()), "ended", sep="\n", flush=True)


def _started(service: "Service", name: str, set_points: Mapping[str, float]) -> None:
    """Start a drive once there is a link to it; one that trips then shows its fault. Raises BenchError, DriveError."""
    deadline = time.monotonic() + _LINKED
    while True:
        try:
            service.start_drive(name, set_points, "pmsm-bench up")
            break
        except HeldError as error:
            _console.print(f"       watched only: {error}")
            return
        except FaultError as error:
            _console.print(f"       not started: {error}; pmsm-bench reset {name} leaves a fault whose cause is gone")
            return
        except LostError:
            if time.monotonic() > deadline:
                raise
            time.sleep(_LISTENS)
    given = ", ".join(f"{key} = {value:g}" for key, value in set_points.items() if value)
    _console.print(f"       started{f' with {given}' if given else ''}, controlled by this service; it stops with it")


def meanwhile(work: Callable[[], None]) -> None:
    """Do it in a thread of its own: a compiler that a signal interrupts fails in its own words."""
    made = in_thread(work)
    while not wait((made,), _LISTENS).done:
        pass
    made.result()


def _emulator_command(urls: list[str], scenario: str) -> list[str]:
    places = [part for url in urls for part in ("--at", url)]
    return [sys.executable, "-m", "emulator", *places, "--scenario", scenario]


@contextlib.contextmanager
def _emulator(url: str, scenario: str) -> Generator[Mapping[str, Mapping[str, float]]]:
    """The emulated drive's process, once it says that it is on its bus; its data sheet, by kind and name.

    Raises ConfigError when it cannot be.
    """
    with tempfile.TemporaryFile("w+") as errors, subprocess.Popen(  # a pipe that nobody reads would stop it when full
        [*_emulator_command([url], scenario), "--with-input"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors, text=True,
        start_new_session=True,  # Ctrl-C reaches the service alone, which then ends the drive
    ) as process:
        try:
            with _console.status("preparing the emulated drive (compiles at the first start)"):
                place, sheet = _next_line(process), _next_line(process)
            if place is None or sheet is None:
                with contextlib.suppress(subprocess.TimeoutExpired):  # it may be about to end by itself
                    process.wait(_END)
                silent = f"said nothing for {_READY_TIMEOUT:g} s: is there much other work?"
                why = silent if process.poll() is None else "did not start"
                process.kill()
                process.wait()
                errors.seek(0)
                said = errors.read().strip().removeprefix("pmsm-bench emulate: ")
                busy = "; `pmsm-bench up --at URL` puts it elsewhere" if said.endswith("in use") else ""
                raise ConfigError(said + busy if said else f"the emulated drive {why}")
            _console.print(place)
            yield json.loads(sheet)
        finally:
            process.terminate()
            try:
                process.wait(_END)
            except subprocess.TimeoutExpired:
                process.kill()


def _next_line(process: "subprocess.Popen[str]") -> str | None:
    """What the process says next; None when it ends, or is silent for too long, before it says anything."""
    assert process.stdout is not None
    line = in_thread(process.stdout.readline)
    return line.result().strip() or None if wait((line,), _READY_TIMEOUT).done else None
