"""What the bench itself can refuse; a drive's failures are in `drivers.errors`.

    BenchError
      LimitError       the bench said no, before the wire
      ConflictError    it may be asked for, but not now: somebody writes, something has ended
      ConfigError      a configuration, machine file or option that cannot be
      RecordingError   a recording that cannot be read as one
      UnavailableError a part of the service that does not answer now
      InternalError    the service failed: a fault of our own
    UnknownError       nothing of that name
"""

import json


class BenchError(Exception):
    """Any refusal of the bench; its text is a sentence for the user."""


class LimitError(BenchError):
    """The bench said no, before the wire."""


class ConflictError(BenchError):
    """What may be asked for, but not now."""


class ConfigError(BenchError):
    """A configuration, machine file or option that cannot be."""


class RecordingError(BenchError):
    """A recording that cannot be read as one."""


class UnavailableError(BenchError):
    """A part of the service that does not answer now."""


class InternalError(BenchError):
    """The service failed: a fault of our own."""


class UnknownError(KeyError):
    """Nothing of that name: no drive, no capture, no recording."""

    def __str__(self) -> str:
        return str(self.args[0])


def shown(value: object) -> str:
    """A foreign value as a sentence shows it: on one line, and short whatever came."""
    try:
        text = json.dumps(value) if value is None or isinstance(value, bool) else repr(value)  # as who asks writes it
    except (ValueError, RecursionError):  # a number of thousands of digits; nesting without end
        return f"something too long to show ({type(value).__name__})"
    return text if len(text) <= 80 else f"{text[:77]}..."
