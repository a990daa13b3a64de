"""The drive's state machine as its words tell it: CiA 402 (IEC 61800-7-201), and the error codes of its faults.

Pure: numbers to names and back. What moves the machine is the drive's business.
"""

from enum import Enum
from typing import Final


class State(Enum):
    """States of the machine: value (bits of the status word, mask that they are looked for under)."""

    NOT_READY = (0x0000, 0x004F)
    SWITCH_ON_DISABLED = (0x0040, 0x004F)
    READY_TO_SWITCH_ON = (0x0021, 0x006F)
    SWITCHED_ON = (0x0023, 0x006F)
    OPERATION_ENABLED = (0x0027, 0x006F)
    QUICK_STOP_ACTIVE = (0x0007, 0x006F)
    FAULT_REACTION_ACTIVE = (0x000F, 0x004F)
    FAULT = (0x0008, 0x004F)

    @property
    def bits(self) -> int:
        """Of the status word."""
        return self.value[0]

    def __str__(self) -> str:
        return self.name.lower().replace("_", " ")


class Command(Enum):
    """Commands of the control word: value (bits, mask that they are looked for under)."""

    SHUTDOWN = (0x06, 0x87)
    SWITCH_ON = (0x07, 0x8F)
    ENABLE_OPERATION = (0x0F, 0x8F)
    DISABLE_VOLTAGE = (0x00, 0x82)
    QUICK_STOP = (0x02, 0x86)
    FAULT_RESET = (0x80, 0x80)  # on the rising edge of its bit

    @property
    def bits(self) -> int:
        """Of the control word."""
        return self.value[0]


def state_of(status_word: int) -> State | None:
    """The state that a status word tells; None where it tells none."""
    return next((state for state in State if status_word & state.value[1] == state.bits), None)


def command_of(control_word: int) -> Command | None:
    """The command that a control word gives; None where it gives none."""
    return next((command for command in Command if control_word & command.value[1] == command.bits), None)


OVERCURRENT: Final = 0x2310
OVERVOLTAGE: Final = 0x3210
UNDERVOLTAGE: Final = 0x3220
OVERTEMPERATURE_MOTOR: Final = 0x4210
SPEED_ERROR: Final = 0x8400  # of the speed control; 0x8611 is that of a position control
OVERSPEED: Final = 0x8481  # in the range of the speed control, as makers of drives use it
COMMUNICATION: Final = 0x8130  # nothing was heard of the bench: its lease was not renewed, or its watchdog not fed

ERRORS: Final = {
    OVERCURRENT: (
        "overcurrent", "check the wiring, the current control's parameters and the angle before it is started again"
    ),
    OVERVOLTAGE: ("dc-link overvoltage", "brake slower, or give the dc link somewhere to put the energy"),
    UNDERVOLTAGE: ("dc-link undervoltage", "check the supply"),
    OVERTEMPERATURE_MOTOR: ("motor too hot", "let it cool down"),
    SPEED_ERROR: (
        "the speed does not follow its reference", "check the load and the angle's sign, or allow the speed more time"
    ),
    OVERSPEED: (
        "overspeed",
        "wait until the shaft stands, then check the angle's sign and what holds the speed: current control does not",
    ),
    COMMUNICATION: ("the bench fell silent", "see whether the bench still runs, then reset the fault and start again"),
}
"""Error codes with what they are, and what to do about them."""


def error_text(code: int) -> str:
    """An error code in words."""
    return ERRORS.get(code, ("unknown error", ""))[0]


def error_advice(code: int) -> str:
    """What to do about it."""
    return ERRORS.get(code, ("", "look the number up in the drive's manual"))[1]


def error_register(code: int) -> int:
    """Object 0x1001 (CiA 301, 7.5.2.2) for an error code: generic, and its kind."""
    if code == 0:
        return 0
    if 0x8300 <= code <= 0x86FF:  # control of torque, speed, position: of the device profile
        return 0x01 | 0x20
    kind = {0x2: 0x02, 0x3: 0x04, 0x4: 0x08, 0x8: 0x10}.get(code >> 12, 0x80)
    return 0x01 | kind
