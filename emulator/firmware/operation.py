"""The drive's state machine by CiA 402: what a control word does in which state, faults, quick stop, the watchdog.

Transitions by IEC 61800-7-201. Knows nothing of what the bridge does when it is on, or of buses.
"""

from dataclasses import dataclass
from typing import Final

from drivers.wire.cia402 import COMMUNICATION, Command, State, command_of

_POWERED: Final = frozenset({State.OPERATION_ENABLED})

_TRANSITIONS: Final[dict[tuple[State, Command], State]] = {
    (State.SWITCH_ON_DISABLED, Command.SHUTDOWN): State.READY_TO_SWITCH_ON,
    (State.READY_TO_SWITCH_ON, Command.SWITCH_ON): State.SWITCHED_ON,
    (State.READY_TO_SWITCH_ON, Command.ENABLE_OPERATION): State.OPERATION_ENABLED,
    (State.READY_TO_SWITCH_ON, Command.DISABLE_VOLTAGE): State.SWITCH_ON_DISABLED,
    (State.READY_TO_SWITCH_ON, Command.QUICK_STOP): State.SWITCH_ON_DISABLED,
    (State.SWITCHED_ON, Command.ENABLE_OPERATION): State.OPERATION_ENABLED,
    (State.SWITCHED_ON, Command.SHUTDOWN): State.READY_TO_SWITCH_ON,
    (State.SWITCHED_ON, Command.DISABLE_VOLTAGE): State.SWITCH_ON_DISABLED,
    (State.SWITCHED_ON, Command.QUICK_STOP): State.SWITCH_ON_DISABLED,
    (State.OPERATION_ENABLED, Command.SWITCH_ON): State.SWITCHED_ON,
    (State.OPERATION_ENABLED, Command.SHUTDOWN): State.READY_TO_SWITCH_ON,
    (State.OPERATION_ENABLED, Command.DISABLE_VOLTAGE): State.SWITCH_ON_DISABLED,
    (State.OPERATION_ENABLED, Command.QUICK_STOP): State.QUICK_STOP_ACTIVE,
    (State.QUICK_STOP_ACTIVE, Command.DISABLE_VOLTAGE): State.SWITCH_ON_DISABLED,
    (State.QUICK_STOP_ACTIVE, Command.ENABLE_OPERATION): State.OPERATION_ENABLED,
}


@dataclass(slots=True)
class Operation:
    """The machine; methods change it in place."""

    state: State = State.SWITCH_ON_DISABLED
    error_code: int = 0
    heard: int = 0  # tick at which the bench was last heard
    _reset_bit: bool = False

    @property
    def powered(self) -> bool:
        """The bridge is on."""
        return self.state in _POWERED

    def command(self, control_word: int) -> None:
        """Take a control word; one that commands nothing in this state changes nothing."""
        reset, self._reset_bit = bool(control_word & Command.FAULT_RESET.bits) and not self._reset_bit, bool(
            control_word & Command.FAULT_RESET.bits
        )
        if self.state is State.FAULT:
            if reset:
                self.state, self.error_code = State.SWITCH_ON_DISABLED, 0
            return
        command = command_of(control_word)
        if command is not None:
            self.state = _TRANSITIONS.get((self.state, command), self.state)

    def fault(self, code: int) -> None:
        """Go into fault, unless there already: the first cause stands."""
        if self.state is not State.FAULT:
            self.state, self.error_code = State.FAULT, code

    def watch(self, tick: int, patience: int) -> None:
        """Go into fault where the bridge is on and nothing was heard for more than `patience` ticks; 0: never."""
        if patience and self.powered and tick - self.heard > patience:
            self.fault(COMMUNICATION)
