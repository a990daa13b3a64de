"""Hum of the current channels: a loop between grounds, a supply's ripple, a field through the sensors.

    i_k,measured = i_k + amplitude_k cos(2 pi f t + phase_k)

as a vector:  i_measured = i + (forth exp(j 2 pi f t) + back exp(-j 2 pi f t)) exp(-j theta_e)

and by three sensors a sum that hums, which tells the channel; of two the third phase is what they leave. Where
L_d = L_q the machine's equation has, for it, a voltage of the same frequency, -(R_s +- j 2 pi f L) times as large: a
`mains_voltage` does the same. With saliency it makes, besides, what turns with twice the angle. With the bridge off
only the sensors' is there. What a current control makes of it acts, and is recorded. Derived here.
"""

import cmath

from estimator.arrays import Array, Vector
from estimator.physics.current_sensing import CurrentError
from estimator.physics.effect import Parameter, Sizes, rated
from estimator.physics.mains import FREQUENCY, PARTS, TYPICAL, phasors, shapes, turning
from estimator.physics.rows import Rows
from estimator.physics.vectors import AXES


def error(rows: Rows, sizes: Sizes) -> Vector:
    """Of the stationary current vector, A."""
    forth, back = phasors(sizes)
    turn = turning(rows, float(sizes[6]))
    return forth * turn + back * turn.conj()


def zero(rows: Rows, sizes: Sizes) -> Array:
    """Mean of the three channels' errors, A."""
    return (complex(sizes[4], -sizes[5]) * turning(rows, float(sizes[6]))).real


def _told(rows: Rows, sizes: Sizes) -> dict[str, tuple[float, str]]:
    """Of the channels; without the sum of three, less what these have in common."""
    forth, back = phasors(sizes)
    common = 0j if rows.zero is None else complex(sizes[4], -sizes[5])
    each = [forth * axis.conjugate() + (back * axis.conjugate()).conjugate() + common for axis in AXES]
    largest = max(each, key=abs)
    return {
        "frequency": (sizes[6], "Hz"), **{f"amplitude_{k}": (abs(x), "A") for k, x in zip("abc", each, strict=True)},
        "phase": (cmath.phase(largest), "rad"),
    }  # fmt: skip


EFFECT = CurrentError(
    "current_sensor_hum", "mains hum of the current sensors",
    (
        *(Parameter(name, "A", TYPICAL, rated(-0.3), rated(0.3)) for name in (*PARTS, "zero_cos", "zero_sin")),
        FREQUENCY,
    ),
    shapes,
    "a line at the mains' frequency in the stationary frame, and in the sum of three currents",
    ("mains_voltage",),
    error=error,
    zero=zero,
    told=_told,
    without_current=True,
    discrepancy=1e-5,
)
