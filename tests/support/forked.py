"""Processes of the bench and of the emulated drive, forked from one that has imported and compiled all they need.

They are what `python -m MODULE` is, but for a second and a half of importing each. A process of its own forks them, in
which no thread runs; it tells how they end, and ends with the tests that it was started for.
"""

import atexit
import contextlib
import importlib
import json
import os
import select
import signal
import socket
import subprocess
import sys
import traceback
from functools import cache
from pathlib import Path
from typing import Any, Final

_READY: Final = 240.0  # s, the first start compiles
_MOST: Final = 1 << 16  # bytes of a request
_INHERITED: Final = (signal.SIGHUP, signal.SIGTERM)  # signals that a process may be begun without, as by nohup


class Forked(subprocess.Popen[str]):
    """A module's `main` as a process: `args` are its name and its arguments."""

    def __init__(self, module: str, *arguments: str, **options: Any) -> None:
        self._told, self._tells = socket.socketpair()
        super().__init__([module, *arguments], text=True, **options)

    def _execute_child(  # in place of an exec; its arguments are those of CPython 3.11 and later
        self, args: list[str], _executable: Any, _preexec: Any, _close_fds: Any, _pass_fds: Any, cwd: Any, env: Any,
        _info: Any, _flags: Any, _shell: Any, stdin: int, _in: int, _out: int, stdout: int, _err: int, stderr: int,
        *_others: Any,
    ) -> None:  # fmt: skip
        nothing = os.open(os.devnull, os.O_RDWR)
        ends = [nothing if stdin < 0 else stdin, 1 if stdout < 0 else stdout, 2 if stderr < 0 else stderr]
        asked = {
            "args": args, "cwd": os.fspath(cwd or Path.cwd()), "env": dict(os.environ if env is None else env),
            "ignored": [number for number in _INHERITED if signal.getsignal(number) is signal.SIG_IGN],
        }  # fmt: skip
        socket.send_fds(_parent(), [json.dumps(asked).encode()], [self._tells.fileno(), *ends])
        self._tells.close()
        for end in {nothing, *(end for end in (stdin, stdout, stderr) if end >= 0)}:
            os.close(end)
        self.pid = int.from_bytes(self._told.recv(4), "big")
        self._child_created = True

    def _internal_poll(self, *_: Any, **__: Any) -> int | None:
        return self._heard(0.0)

    def _wait(self, timeout: float | None) -> int:
        if self._heard(timeout) is None:
            raise subprocess.TimeoutExpired(self.args, timeout or 0.0)
        assert self.returncode is not None
        return self.returncode

    def _heard(self, timeout: float | None) -> int | None:
        """How it has ended, within so many s; None where it has not."""
        if self.returncode is None and select.select([self._told], [], [], timeout)[0]:
            self.returncode = int.from_bytes(self._told.recv(4), "big", signed=True)
            self._told.close()
        return self.returncode


@cache
def _parent() -> socket.socket:
    """To the process that forks, which is begun once and ends with this one."""
    ours, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with its:
        process = subprocess.Popen(
            [sys.executable, "-m", "tests.support.forked", str(its.fileno())], pass_fds=[its.fileno()],
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
        )  # fmt: skip

    def end() -> None:
        ours.close()
        process.wait(10.0)

    atexit.register(end)
    ours.settimeout(_READY)
    assert ours.recv(1) == b"R"
    return ours


def prepare() -> None:
    """Import and compile what children need."""
    from bench.live.method import warm_up
    from emulator.drive.virtual_drive import VirtualDrive
    from emulator.scenario.scenarios import PAPER

    for module in ("emulator.__main__", "bench.cli.main", "bench.api.server", "bench.service.service"):
        importlib.import_module(module)
    warm_up()
    VirtualDrive(PAPER).warm_up()


def _serve(control: socket.socket) -> int | None:
    """Fork as asked, until nobody asks any more; in a child, its exit status."""
    told: dict[int, socket.socket] = {}  # by process
    woken, wake = socket.socketpair()
    wake.setblocking(False)
    signal.set_wakeup_fd(wake.fileno())
    signal.signal(signal.SIGCHLD, lambda _number, _frame: None)
    while True:
        ready, _, _ = select.select([control, woken], [], [])
        if woken in ready:
            woken.recv(4096)
            with contextlib.suppress(ChildProcessError):
                while (ended := os.waitpid(-1, os.WNOHANG))[0]:
                    code = os.waitstatus_to_exitcode(ended[1])
                    with told.pop(ended[0]) as one, contextlib.suppress(OSError):
                        one.sendall(code.to_bytes(4, "big", signed=True))
        if control in ready:
            asked, ends, _, _ = socket.recv_fds(control, _MOST, 4)
            if not asked:
                return None
            pid = os.fork()
            if pid == 0:
                for other in (control, woken, wake, *told.values()):
                    other.close()
                return _become(json.loads(asked), ends)
            told[pid] = socket.socket(fileno=ends[0])
            told[pid].sendall(pid.to_bytes(4, "big"))
            for end in ends[1:]:
                os.close(end)


def _become(asked: dict[str, Any], ends: list[int]) -> int:
    """Be a module's `main`, with these ends as standard input, output and errors."""
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    for number in _INHERITED:
        signal.signal(number, signal.SIG_IGN if number in asked["ignored"] else signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.close(ends[0])
    for number, end in enumerate(ends[1:]):
        os.dup2(end, number)
        os.close(end)
    os.environ.clear()
    os.environ.update(asked["env"])
    os.chdir(asked["cwd"])
    module, *arguments = asked["args"]
    sys.argv = [module, *arguments]
    try:
        return importlib.import_module(module).main() or 0
    except SystemExit as ended:
        return ended.code if isinstance(ended.code, int) else 0 if ended.code is None else 1
    except BaseException:  # noqa: BLE001 - as the interpreter does it
        traceback.print_exc()
        return 1


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of a terminal: the tests end it
    prepare()
    with socket.socket(fileno=int(sys.argv[1])) as asking:
        asking.sendall(b"R")
        sys.exit(_serve(asking))
