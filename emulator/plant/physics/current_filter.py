"""What lies between the phase currents and what the drive knows of them: a filter, a mean over periods, or of samples.

    tau d(i_f)/dt = i - i_f                                    an RC before the converter
    i_m(t) = integral of i_f from t - n T_s to t over n T_s    a sigma-delta converter, sinc filter of first order
    the mean of the last samples                               firmware

M. Oljaca, T. Hendrick, "Combining the ADS1202 with an FPGA digital filter for current measurement in motor control
applications", Texas Instruments SBAA094, 2003. Whatever lags turns the currents behind as the rotor turns, and smears
their steps; a mean over whole periods has no ripple of the pulses in it.
"""

from typing import Annotated, NamedTuple

from emulator.bounds import Bound
from emulator.kernel import kernel

MOST = 3  # periods of a mean, and samples before the latest


class CurrentFilter(NamedTuple):
    """Sizes."""

    tau: Annotated[float, Bound("s", low=0.0, high=1e-2)] = 0.0
    periods: Annotated[int, Bound("periods", low=0, high=MOST)] = 0  # that each value is the mean over; 0: an instant
    samples: Annotated[int, Bound("samples", low=1, high=1 + MOST)] = 1  # that each value is the mean of


Charges = tuple[complex, complex, complex]
"""C, that had come through at the sample before, and at the two before that."""


@kernel
def mean_current(periods: int, T_s: float, charge: complex, before: Charges) -> complex:
    """Mean (A) over so many periods up to a sample at which so much charge (C) has come through."""
    return (charge - before[periods - 1]) / (periods * T_s)


@kernel
def passed(charge: complex, before: Charges) -> Charges:
    """Those of the next sample."""
    return (charge, before[0], before[1])
