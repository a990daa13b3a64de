"""The service's REST interface as the command line asks it: every failure is a BenchError with a sentence."""

import contextlib
import json
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, Final, cast
from urllib.parse import quote

import httpx

from bench.errors import BenchError, InternalError, LimitError, UnavailableError, shown
from bench.files import token_file, write_new
from bench.service import token

TOKEN_VARIABLE: Final = "PMSM_BENCH_TOKEN"
_PATIENCE: Final = 60.0  # s for a service that is started anew
_PERIOD: Final = 0.1  # s between two questions
_CANCELLED: Final = 10.0  # s that the end of a job is waited for that is cancelled
_ENDS: Final = ("done", "failed", "cancelled")  # states of a capture, an experiment
_PIECE: Final = 1 << 20  # bytes
_BYTES: Final = {"Content-Type": "application/octet-stream"}  # of a file
_JSON: Final = {"Content-Type": "application/json"}  # of every PUT and POST, also of one without a body


class Rest:
    """A service at an address."""

    def __init__(self, client: httpx.Client, service: str) -> None:
        """Use `rest_at`."""
        self._client, self._service = client, service

    def call(
        self, method: str, *path: str, body: object = None, key: str = "", query: dict[str, str] | None = None,
        under: str = "drives",
    ) -> dict[str, Any]:
        """The JSON object at /api/UNDER/PATH, which has `key`. Raises UnavailableError where nobody answers."""
        try:
            text = None if body is None else json.dumps(body, allow_nan=False)
        except ValueError:
            raise BenchError(f"expected finite numbers, got {shown(body)}") from None
        headers = self._headers() | ({} if method in ("GET", "DELETE") else _JSON)
        try:
            address = self._address(under, path)
            response = self._client.request(method, address, content=text, params=query, headers=headers)
            content = response.json()
        except (httpx.HTTPError, httpx.InvalidURL, ValueError) as error:
            raise self._unanswered(error, "does not answer") from None
        if response.is_success and isinstance(content, dict) and key in content:
            return cast(dict[str, Any], content)
        if isinstance(content, dict) and "detail" in content:
            failed = response.status_code == int(httpx.codes.INTERNAL_SERVER_ERROR)
            told = cast(dict[str, Any], content)
            if told.get("problems") and not failed:
                raise LimitError("\n".join(told["problems"]))
            raise (InternalError if failed else BenchError)(str(told["detail"]))
        raise BenchError(f"expected a bench service at {self._service}, got another answer ({response.status_code})")

    def download(self, *path: str) -> bytes:
        """The file at /api/drives/PATH."""
        try:
            return self._client.get(self._address("drives", path), headers=self._headers()).raise_for_status().content
        except (httpx.HTTPError, httpx.InvalidURL) as error:
            raise self._unanswered(error, "did not hand out the file") from None

    def _headers(self) -> dict[str, str]:
        """With the token that the user gives; that of this machine's file goes to no other machine."""
        said = os.environ.get(TOKEN_VARIABLE)
        if said is not None:
            return {"Authorization": f"Bearer {token.checked(said, f'environment variable {TOKEN_VARIABLE}')}"}
        if not os.path.lexists(token_file()) or not _is_here(self._service):
            return {}
        return {"Authorization": f"Bearer {token.read(token_file())}"}

    def save(self, path: Path, *parts: str, query: dict[str, str]) -> Path:
        """Download a recording's file into a new one, piece by piece; tell which. Raises BenchError, OSError."""
        address = self._address("recordings", parts)
        try:
            with self._client.stream("GET", address, params=query, headers=self._headers()) as response:
                if not response.is_success:
                    raise BenchError(str(json.loads(response.read()).get("detail", response.status_code)))
                return write_new(path, lambda file: file.writelines(response.iter_bytes()))
        except (httpx.HTTPError, httpx.InvalidURL, ValueError) as error:
            raise self._unanswered(error, "did not hand out the file") from None

    def send(self, content: BinaryIO, under: str, query: dict[str, str]) -> dict[str, Any]:
        """What comes of a file that is sent to /api/UNDER. Raises BenchError."""
        headers, size = self._headers() | _BYTES, os.fstat(content.fileno()).st_size
        try:
            response = self._client.post(
                self._address(under, ()), params={key: value for key, value in query.items() if value},
                content=iter(partial(content.read, _PIECE), b""), headers=headers | {"Content-Length": str(size)},
            )  # fmt: skip
            told: Any = response.json()
        except (httpx.HTTPError, httpx.InvalidURL, ValueError) as error:
            raise self._unanswered(error, "did not take the file") from None
        answer = cast(dict[str, Any], told) if isinstance(told, dict) else {}
        if response.is_success and "id" in answer:
            return answer
        raise BenchError(str(answer.get("detail", response.status_code)))

    def _unanswered(self, error: Exception, what: str) -> UnavailableError:
        """A service that is not there, or that did not do `what`; where nobody listens, what to do."""
        if not isinstance(error, httpx.ConnectError | httpx.UnsupportedProtocol | httpx.InvalidURL):
            return UnavailableError(f"the service at {self._service} {what}: {error}")
        nobody = isinstance(error, httpx.ConnectError) and "refused" in str(error)
        why = "start one by `make run` or `pmsm-bench serve --config FILE`" if nobody else error
        return UnavailableError(f"no bench service answers at {self._service}: {why}")

    def _address(self, under: str, path: tuple[str, ...]) -> str:
        return "/".join([f"{self._service.rstrip('/')}/api/{under}", *(quote(part, safe="") for part in path)])


@contextmanager
def rest_at(service: str | None, timeout: float) -> Generator[Rest]:
    """The interface of a service, the usual one where none is named; `timeout` in s for one answer."""
    with httpx.Client(timeout=timeout) as client:
        yield Rest(client, service or f"http://127.0.0.1:{os.environ.get('PMSM_BENCH_PORT', '8080')}")


class Job:
    """A capture or an experiment that the service does for a command."""

    def __init__(self, rest: Rest, drive: str, kind: str, given: dict[str, Any]) -> None:
        """`kind`: captures or experiments. It is asked for here. Raises BenchError."""
        self._rest = rest
        self.said = rest.call("POST", drive, kind, body=given, key="state")
        self.id = str(self.said["id"])
        self._path = (drive, kind, self.id)

    def follow(self, show: Callable[[dict[str, Any]], object], wait: Callable[[str], object]) -> None:
        """To its end, which `said` tells then; Ctrl-C, SIGTERM and a closed terminal cancel it.

        A service that is started anew goes on with it, or keeps what there is: `wait` is told why there is no answer
        yet. Raises BenchError, also where there is none for long.
        """
        try:
            with _interrupted_by_any():
                while self.said["state"] not in _ENDS:
                    show(self.said)
                    time.sleep(_PERIOD)
                    self.said = self._told(wait)
        except KeyboardInterrupt:
            with contextlib.suppress(BenchError):
                self._rest.call("DELETE", *self._path)
            with contextlib.suppress(BenchError):
                self._tell_end()
            raise

    def _tell_end(self) -> None:
        """How one that is cancelled ends, as soon as it has. Raises BenchError."""
        deadline = time.monotonic() + _CANCELLED
        while self.said["state"] not in _ENDS and time.monotonic() < deadline:
            time.sleep(_PERIOD)
            self.said = self._rest.call("GET", *self._path, key="state")
        state, reason = self.said["state"], self.said["reason"]
        how = f"{state}: {reason}" if reason else state if state in _ENDS else "has not ended yet: see the drive"
        print(f"pmsm-bench: {self.id} {how}", file=sys.stderr)

    def _told(self, wait: Callable[[str], object]) -> dict[str, Any]:
        deadline = time.monotonic() + _PATIENCE
        while True:
            try:
                return self._rest.call("GET", *self._path, key="state")
            except UnavailableError as error:
                if time.monotonic() > deadline:
                    raise
                wait(str(error))
                time.sleep(_PERIOD)

    def fetch(self, path: Path, what: str) -> Path:
        """Its recording, in a new file. Raises BenchError, which tells that the service still has `what`."""
        try:
            recording = self._rest.download(*self._path, "file")
            return write_new(path, lambda file: file.write(recording))
        except (OSError, UnavailableError) as error:
            why = f"{path}: cannot be written: {error.strerror or error}" if isinstance(error, OSError) else str(error)
            raise BenchError(f"{why}; the service still has {what} {self.id} of drive {self._path[0]}") from None


@contextmanager
def _interrupted_by_any() -> Generator[None]:
    """SIGTERM and a closed terminal do as Ctrl-C does; where another thread than the main one asks, they do not."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(_number: int, _frame: object) -> None:
        raise KeyboardInterrupt

    numbers = [signal.SIGTERM, *([hang_up] if (hang_up := getattr(signal, "SIGHUP", None)) is not None else [])]
    before = {
        number: signal.signal(number, interrupt) for number in numbers if signal.getsignal(number) is not signal.SIG_IGN
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _is_here(service: str) -> bool:
    """Whether a service's address is one of this machine's: one that can be listened at."""
    try:
        found = socket.getaddrinfo(httpx.URL(service).host, 0, type=socket.SOCK_STREAM)
        for family, kind, protocol, _, address in found:
            with socket.socket(family, kind, protocol) as there:
                there.bind(address)
    except (OSError, ValueError, httpx.InvalidURL):
        return False
    return bool(found)
