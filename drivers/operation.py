"""What a bench does with any drive's state machine, by its words alone: the same over every transport.

CiA 402. Knows nothing of buses.
"""

import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from drivers.drive import Drive
from drivers.errors import FaultError, FrameError, LostError, NoReplyError, RefusedError
from drivers.wire.cia402 import Command, State, error_text, state_of
from drivers.wire.dictionary import RESET_WORD, RESTORE_WORD, STORE_WORD
from drivers.wire.memory import MemoryState

Write = Callable[[str, float], None]
PATIENCE: Final = 2.0  # s, for a state to be reached
BOOT: Final = 10.0  # s, for a drive to be there again after a reset
_POLL: Final = 0.005  # s

_TO_ENABLE: Final = {
    State.SWITCH_ON_DISABLED: Command.SHUTDOWN,
    State.READY_TO_SWITCH_ON: Command.SWITCH_ON,
    State.SWITCHED_ON: Command.ENABLE_OPERATION,
    State.QUICK_STOP_ACTIVE: Command.DISABLE_VOLTAGE,
}


@dataclass(frozen=True, slots=True)
class Fault:
    """Why a drive is in fault."""

    code: int  # CiA 402 error code
    text: str


def state(drive: Drive) -> State:
    """The drive's state. Raises DriveError."""
    word = int(drive.read("status_word"))
    found = state_of(word)
    if found is None:
        raise FrameError(f"status word 0x{word:04X} is no state of CiA 402")
    return found


def off_words(now: State, fault: Fault | None) -> str:
    """Why a drive in this state drives no voltage, a clause; empty where it does."""
    if now is State.OPERATION_ENABLED:
        return ""
    if fault is not None:
        return f"the drive is in fault: {fault.text} (0x{fault.code:04X})"
    return f"the drive is off ({now})"


def off(drive: Drive) -> str:
    """Why a drive, as it is now, drives no voltage, a clause; empty where it does. Raises DriveError."""
    now = state(drive)
    return off_words(now, fault(drive) if now is State.FAULT else None)


def fault(drive: Drive) -> Fault | None:
    """What put the drive into fault; None when nothing did."""
    code = int(drive.read("error_code"))
    return Fault(code, error_text(code)) if code else None


def enable(drive: Drive) -> None:
    """Switch the bridge on, step by step, where no control lease is needed. Raises FaultError when in fault."""
    deadline = time.monotonic() + PATIENCE
    while (now := state(drive)) is not State.OPERATION_ENABLED:
        _check_fault(drive, now)
        if now not in _TO_ENABLE:
            _await_change(drive, now, deadline)
            continue
        _command(drive, _TO_ENABLE[now])
        _await_change(drive, now, deadline)


def disable(drive: Drive) -> None:
    """Switch the bridge off; in fault it is off already."""
    _command(drive, Command.DISABLE_VOLTAGE)
    await_state(drive, {State.SWITCH_ON_DISABLED, State.FAULT})


def quick_stop(drive: Drive) -> None:
    """Stop at once; the bridge is off after it, and only `disable`, then `enable` lead on."""
    _command(drive, Command.QUICK_STOP)
    await_state(drive, {State.QUICK_STOP_ACTIVE, State.SWITCH_ON_DISABLED, State.FAULT})


def reset_fault(drive: Drive) -> None:
    """Leave fault; raises FaultError where its cause remains."""
    drive.write("control_word", 0.0)
    _command(drive, Command.FAULT_RESET)
    deadline = time.monotonic() + PATIENCE
    while (now := state(drive)) is State.FAULT:
        if time.monotonic() > deadline:
            _check_fault(drive, now)
        time.sleep(_POLL)
    drive.write("control_word", 0.0)


def store(drive: Drive, write: Write | None = None) -> None:
    """Keep all parameters over a power cycle; a drive that tells of its memory says then that it has.

    `write`: by whom, where not by anybody. Raises NoReplyError where it has not.
    """
    _kept(drive, "store", STORE_WORD, write or drive.write)


def restore(drive: Drive, write: Write | None = None) -> None:
    """Parameters as delivered, from the next reset on; as `store`."""
    _kept(drive, "restore", RESTORE_WORD, write or drive.write)


def _kept(drive: Drive, command: str, word: int, write: Write) -> None:
    if not drive.identity.has_memory:
        write(command, word)
        return
    before, deadline = drive.read("memory_count"), time.monotonic() + PATIENCE
    try:
        write(command, word)
    except RefusedError:  # of a repetition, since the first is under way
        if drive.read("memory_state") != MemoryState.WRITING and drive.read("memory_count") == before:
            raise
    while (count := drive.read("memory_count")) == before:
        if time.monotonic() > deadline:
            raise NoReplyError(f"the drive has not written its memory {PATIENCE:g} s after `{command}`")
        time.sleep(_POLL)
    if count != before + 1:
        raise FrameError(f"the drive counts {count:g} writes of its memory, {before + 1:g} were to be")


def reset(link: Callable[[], Drive], write: Write | None = None) -> Drive:
    """Have a drive start anew, and wait until it has; the drive as it is then to be had.

    `link` tells it each time: its link may end with the reset. Raises RefusedError where it is on, NoReplyError.
    """
    drive = link()
    before, begun = drive.read("tick"), time.monotonic()
    with contextlib.suppress(NoReplyError, LostError):  # it may be gone before it answers
        (write or drive.write)("reset", RESET_WORD)
    while True:
        with contextlib.suppress(NoReplyError, LostError):
            drive = link()
            tick = drive.read("tick")
            if tick < before or tick * drive.identity.T_s < time.monotonic() - begun:  # it had not been up for long
                return drive
        if time.monotonic() > begun + BOOT:
            raise NoReplyError(f"the drive has not started anew {BOOT:g} s after `reset`")
        time.sleep(_POLL)


def check_fault(drive: Drive) -> None:
    """Raise FaultError where the drive is in fault."""
    _check_fault(drive, state(drive))


def _command(drive: Drive, command: Command) -> None:
    drive.write("control_word", float(command.bits))


def _check_fault(drive: Drive, now: State) -> None:
    if now is State.FAULT:
        found = fault(drive)
        code, text = (found.code, found.text) if found else (0, "unknown error")
        raise FaultError(f"the drive is in fault: {text} (0x{code:04X})", code)


def await_state(drive: Drive, wanted: set[State]) -> None:
    """Wait for one of these states. Raises FaultError where a fault comes instead, NoReplyError."""
    deadline = time.monotonic() + PATIENCE
    while (now := state(drive)) not in wanted:
        _check_fault(drive, now)
        _await_change(drive, now, deadline)


def _await_change(drive: Drive, before: State, deadline: float) -> None:
    while (now := state(drive)) is before:
        if time.monotonic() > deadline:
            raise NoReplyError(f"the drive stays in state {now} for more than {PATIENCE:g} s")
        time.sleep(_POLL)

