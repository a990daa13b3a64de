"""What a file to be diagnosed may be: one module a format, each with a `sniff` and a `diagnose`.

`FORMATS` lists them in the order in which `auto` asks; the last one takes what no other knows.
"""

from typing import Final

from bench.diagnoses.diagnosis_request import Request
from bench.diagnoses.formats import lea_thermal, moteus_ld, points, recording, servo_pulses, servo_sine
from bench.diagnoses.formats.format import Format
from bench.errors import BenchError, ConfigError, shown

AUTO: Final = "auto"
FORMATS: Final[dict[str, Format]] = {
    one.name: one
    for one in (
        moteus_ld.FORMAT, lea_thermal.FORMAT, servo_sine.FORMAT, servo_pulses.FORMAT, points.FORMAT, recording.FORMAT
    )
}


def checked_format(name: str) -> str:
    """A format's name, or `auto`. Raises ConfigError."""
    if name not in (AUTO, *FORMATS):
        raise ConfigError(f"--format: expected one of {', '.join((AUTO, *FORMATS))}, got {shown(name)}")
    return name


def format_of(request: Request) -> Format:
    """The format that is asked for, or the first that knows the file."""
    if request.format != AUTO:
        return FORMATS[checked_format(request.format)]
    *first, last = FORMATS.values()
    return next((one for one in first if _knows(one, request)), last)


def _knows(one: Format, request: Request) -> bool:
    try:
        return one.sniff(request.file, request.mapping)
    except (OSError, BenchError):  # whoever reads it will say what is wrong
        return False
