"""A drive whose parameters are read and flashed from a terminal: by its bus, or by its name at a service; alike."""

import getpass
import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final, Protocol

from bench.actions.safety.unfinished import undo
from bench.cli.rest import Rest, rest_at
from bench.errors import ConfigError, UnavailableError
from bench.files import journals_folder
from bench.parameters import flash, journal
from bench.parameters.flash import Around, End, Verdict
from bench.parameters.link import OwnLink
from bench.parameters.parameter_set import ParameterSet, as_document, of_document
from bench.parameters.plan import Change, Plan
from bench.parameters.told import as_begun, as_past
from drivers.wire.dictionary import signal_named

_TIMEOUT: Final = 60.0  # s for one answer: a slow line takes long for all parameters
_PERIOD: Final = 0.1  # s between two looks at a flash
_PATIENCE: Final = 20.0  # s for a service that does not answer meanwhile
_MOST: Final = "1000"  # flashes of the history

Show = Callable[[Plan], object]


@dataclass(frozen=True, slots=True)
class Before:
    """In place of a set: what the drive had before a flash."""

    since: str | None = None  # as the history has it, or a beginning; None: of the latest

    @property
    def asked(self) -> dict[str, str]:
        """As REST takes it."""
        return {} if self.since is None else {"before": self.since}


Given = ParameterSet | Before


class Flashed(Protocol):
    """A drive; each raises BenchError, DriveError."""

    def present(self, name: str) -> ParameterSet:
        """Its parameters as a set of this name."""
        ...

    def plan(self, given: Given) -> Plan:
        """What would change."""
        ...

    def flash(self, given: Given, override: str, show: Show) -> Verdict:
        """Do it; what it will change is shown before."""
        ...

    def resume(self, *, finish: bool) -> Verdict:
        """Finish one that was cut, or roll it back."""
        ...

    def history(self) -> tuple[list[dict[str, Any]], dict[str, Any] | None]:
        """All that have ended, the newest last, and one that was cut, as plain values."""
        ...


@contextmanager
def drive_at(named: str, service: str | None) -> Generator[Flashed]:
    """A drive by its URL, or by its name at a service, the usual one where none is told. Raises ConfigError."""
    if is_url(named):
        if service is not None:
            raise ConfigError(f"expected a drive's name with --service, got the URL {named}")
        try:
            link = OwnLink(named)
        except ValueError as error:
            raise ConfigError(str(error)) from None
        with link:
            if left := undo(journals_folder(), link()):
                print(left, file=sys.stderr)
            yield _ByBus(link, named)
        return
    with rest_at(service, _TIMEOUT) as rest:
        yield _ByService(rest, named)


def is_url(named: str) -> bool:
    """Whether a drive is told by its URL: no name has a colon."""
    return ":" in named


class _ByBus:
    """By its bus, with the journals of this user."""

    def __init__(self, link: OwnLink, url: str) -> None:
        self._link, self._url = link, url

    def present(self, name: str) -> ParameterSet:
        return flash.pulled(self._link(), name)

    def plan(self, given: Given) -> Plan:
        return flash.planned(self._link, self._set(given), self._around())

    def flash(self, given: Given, override: str, show: Show) -> Verdict:
        return flash.flash(self._link, self._set(given), self._around(override, show))

    def resume(self, *, finish: bool) -> Verdict:
        return flash.resume(self._link, self._around(), finish=finish)

    def history(self) -> tuple[list[dict[str, Any]], dict[str, Any] | None]:
        identity, folder = self._link().identity, journals_folder()
        left = flash.cut(identity, folder)
        return [as_past(one) for one in journal.past(folder, identity)], None if left is None else as_begun(left)

    def _set(self, given: Given) -> ParameterSet:
        if isinstance(given, Before):
            return flash.before(journals_folder(), self._link().identity, given.since)
        return given

    def _around(self, override: str = "", show: Show = lambda _: None) -> Around:
        return Around(journals_folder(), self._url, getpass.getuser(), override, tell=_tell, planned=show)


class _ByService:
    """By its name at a service."""

    def __init__(self, rest: Rest, name: str) -> None:
        self._rest, self._name = rest, name

    def present(self, name: str) -> ParameterSet:
        query = {"form": "json", "name": name}
        told = self._rest.call("GET", self._name, "parameters", "set", key="entries", query=query)
        return of_document(told, f"drive {self._name}")

    def plan(self, given: Given) -> Plan:
        if isinstance(given, Before):
            path, key = (self._name, "parameters", "rollback"), "changes"
            return _plan_of(self._rest.call("GET", *path, key=key, query=given.asked))
        return _plan_of(
            self._rest.call("POST", self._name, "parameters", "plan", body=as_document(given), key="changes")
        )

    def flash(self, given: Given, override: str, show: Show) -> Verdict:
        to_do = self.plan(given)
        flash.check(to_do, override)
        show(to_do)
        if isinstance(given, Before):
            return self._followed("parameters", "rollback", body=given.asked)
        query = {"override": override} if override else None
        return self._followed("flashes", body=as_document(given), query=query)

    def resume(self, *, finish: bool) -> Verdict:
        return self._followed("parameters", "resume", body={"finish": finish})

    def history(self) -> tuple[list[dict[str, Any]], dict[str, Any] | None]:
        told = self._rest.call("GET", self._name, "flashes", key="past", query={"limit": _MOST})
        return list(reversed(told["past"])), told["cut"]

    def _followed(self, *path: str, body: dict[str, Any], query: dict[str, str] | None = None) -> Verdict:
        """A flash that is asked for, to its end; Ctrl-C leaves it to the service."""
        said, told = self._rest.call("POST", self._name, *path, body=body, key="state", query=query), 0
        while True:
            for step in said["steps"][told:]:
                _tell(step["said"])
            told = len(said["steps"])
            if said["state"] != "running":
                return Verdict(End(said["state"]), len(said["changed"]), said["said"])
            time.sleep(_PERIOD)
            said = self._state(said["id"])

    def _state(self, id_: str) -> dict[str, Any]:
        deadline = time.monotonic() + _PATIENCE
        while True:
            try:
                return self._rest.call("GET", self._name, "flashes", id_, key="state")
            except UnavailableError:
                if time.monotonic() > deadline:
                    raise
                time.sleep(_PERIOD)


def _plan_of(told: dict[str, Any]) -> Plan:
    changes = tuple(
        Change(signal_named(one["signal"]), one["old"], one["new"], one["held"], (one["bits_old"], one["bits_new"]))
        for one in told["changes"]
    )
    return Plan(changes, told["same"], *(tuple(told[key]) for key in ("problems", "doubts", "remarks")))


def _tell(said: str) -> None:
    print(said, file=sys.stderr)
