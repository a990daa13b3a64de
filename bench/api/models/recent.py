"""Shape of what the REST interface says of a drive's last seconds. SI units."""

import math
import re
from typing import Final

from pydantic import BaseModel, Field

from bench.live.recent import SIGNALS, Course, Place, Values

UNITS: Final = {"i_d": "A", "i_q": "A", "u_d": "V", "u_q": "V", "omega_e": "rad/s", "u_dc": "V"}
PLACE: Final = r"\d{1,9}\.\d{1,15}"
"""What a bin's name looks like."""
_DIGITS: Final = 5


class ExtremesModel(BaseModel):
    """A signal by bins; null where no row came, or where it has no value, as voltages while the bridge is off."""

    unit: str = Field(examples=["A"])
    low: list[float | None] = Field(description="least value in each bin", examples=[[1.92, 1.94]])
    high: list[float | None] = Field(description="largest value in each bin", examples=[[2.07, 2.05]])


class RecentModel(BaseModel):
    """A drive's signals over its last seconds, extremes kept, by bins of equal length without one left out."""

    drive: str = Field(examples=["emulated"])
    bin_s: float = Field(description="length of a bin, s", examples=[0.02])
    first: str = Field(
        description="the first bin's name: its number after a dot; the number before counts how often the drive's "
        "clock, or the length of a bin, began anew", examples=["0.12596"],
    )  # fmt: skip
    last: str = Field(description="the last bin's; it may not be full yet: ask again since it", examples=["0.12597"])
    t_drive_s: float = Field(description="drive's clock at the end of the newest row", examples=[251.93])
    age_s: float = Field(description="since then", examples=[0.004])
    signals: dict[str, ExtremesModel] = Field(
        description="by name", json_schema_extra={"propertyNames": {"enum": list(SIGNALS)}}
    )


def place_of(name: str) -> Place | None:
    """A bin by its name; None where that is none."""
    if not re.fullmatch(PLACE, name, re.ASCII):
        return None
    epoch, _, number = name.partition(".")
    return Place(int(epoch), int(number))


def recent_model(drive: str, course: Course, age: float) -> RecentModel:
    """The last seconds as REST shows them."""
    return RecentModel(
        drive=drive, bin_s=course.bin_time, first=str(course.first), last=str(course.last),
        t_drive_s=course.t_end, age_s=age, signals={
            name: ExtremesModel(unit=UNITS[name], low=_told(course.low[name]), high=_told(course.high[name]))
            for name in SIGNALS
        },
    )  # fmt: skip


def _told(values: Values) -> list[float | None]:
    return [float(f"{value:.{_DIGITS}g}") if math.isfinite(value) else None for value in values.tolist()]
