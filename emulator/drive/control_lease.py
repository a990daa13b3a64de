"""Who controls the drive: the lease's holder, for how long still, and what that allows others.

Times are ticks, given in. Knows nothing of state machines, signals' values and buses. What it says of records and words
is in `drivers.wire.lease`.
"""

from dataclasses import dataclass
from enum import Enum

from drivers.wire.cia402 import Command, command_of
from drivers.wire.dictionary import LEASE_TIMES, Signal
from drivers.wire.lease import LOCAL, Action, End, Record


class Denial(Enum):
    """Why somebody may not, right now."""

    HOLDERS_ALONE = "only the holder of the control lease writes it, in a control record"
    HELD = "another client holds the control lease"
    NOT_HELD = "the control lease is not this client's, or no longer"
    BUSY = "not while the bridge is on, or parameters are being stored"


class DeniedError(Exception):
    """Refused, for who asks and when; the value is not to blame."""

    def __init__(self, denial: Denial) -> None:
        super().__init__(denial.value)
        self.denial = denial


@dataclass(slots=True)
class ControlLease:
    """The lease; methods change it in place. `local`: a master inside the drive has control from the start."""

    local: bool = False
    holder: str = ""
    end: End = End.NONE
    _token: int = 0
    _patience: float = 0.0  # s
    _renewed_at: int = 0  # tick
    _renewed: bool = False  # since `passed` was last called

    @property
    def name(self) -> str:
        """Who has control; empty for nobody."""
        return LOCAL if self.local else self.holder

    @property
    def held(self) -> bool:
        """Somebody has control."""
        return self.local or bool(self._token)

    def left(self, tick: int, T_s: float) -> float:
        """Time in s until it ends, -1 for local control, 0 where there is none."""
        if self.local:
            return -1.0
        return max(0.0, self._patience - (tick - self._renewed_at) * T_s) if self._token else 0.0

    def check_record(self, record: Record, longest: float) -> None:
        """Raise DeniedError where the record's client may not, ValueError where its time cannot be."""
        if record.action is Action.TAKE:
            if self.local or (self._token and self._token != record.token):
                raise DeniedError(Denial.HELD)
        elif record.action is Action.RENEW or self.held:
            if self._token != record.token:
                raise DeniedError(Denial.NOT_HELD)
        elif record.values:  # who gives up what has ended already writes nothing
            raise DeniedError(Denial.NOT_HELD)
        if record.action is not Action.RELEASE and not LEASE_TIMES[0] <= record.seconds <= longest:
            raise ValueError(f"a lease lasts {LEASE_TIMES[0]:g} to {longest:g} s, got {record.seconds:g}")

    def take_record(self, record: Record) -> None:
        """What a record that may be does to the lease."""
        if record.action is Action.RELEASE:
            if self.held:
                self.over(End.RELEASED)
            return
        if record.action is Action.TAKE and not self._token:
            self.holder = record.holder
        self._token, self._patience, self._renewed = record.token, record.seconds, True

    def check_write(self, signal: Signal, value: float, powered: bool) -> bool:
        """Whether a write by a client without a token stops the drive, whose bridge is on if `powered`.

        Raises DeniedError where it may not write.
        """
        if signal.name == "control_word":
            return self._check_word(int(value), powered)
        if signal.is_set_point:
            raise DeniedError(Denial.HOLDERS_ALONE)
        if signal.is_guarded and self.held:
            raise DeniedError(Denial.HELD)
        return False

    def passed(self, tick: int, T_s: float) -> bool:
        """Time has come to this tick; whether the lease has run out."""
        if self._renewed:
            self._renewed_at, self._renewed = tick, False
        if not self._token or (tick - self._renewed_at) * T_s <= self._patience:
            return False
        self.over(End.RAN_OUT)
        return True

    def over(self, end: End) -> None:
        """Nobody has control any more."""
        self.local, self.holder, self._token, self.end = False, "", 0, end

    def _check_word(self, word: int, powered: bool) -> bool:
        """Anybody may stop; nobody without a token may start, or lead the states where another has control."""
        command = None if word & Command.FAULT_RESET.bits else command_of(word)
        if command is Command.ENABLE_OPERATION:
            raise DeniedError(Denial.HOLDERS_ALONE)
        if command in (Command.DISABLE_VOLTAGE, Command.QUICK_STOP) or (powered and command is not None):
            return True
        if self.held and (command is not None or word & Command.FAULT_RESET.bits):
            raise DeniedError(Denial.HELD)
        return False
