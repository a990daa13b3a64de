"""What the sum of three measured phase currents says of their sensors: it is zero, or one of them is wrong.

Knows nothing of voltages.
"""

from dataclasses import dataclass
from typing import Final, cast

import numpy as np

from estimator.arrays import Array, Vector
from estimator.diagnosis.answer.sentences import quantity
from estimator.diagnosis.standstill.tones import Tones
from estimator.diagnosis.verdict import Ambiguity, Experiment, Finding, Place, Quantity, Rival

_SHOWS: Final = 0.01  # of the current
_NOISE_FACTOR: Final = 5.0  # times which a sum is
_GAIN_SHARE: Final = 0.9  # of the sum's energy that a gain explains, to be named
_DC: Final = Experiment("a dc current through two phases at a time, against a meter, would tell each sensor's gain")


@dataclass(frozen=True, slots=True)
class Sum:
    """What is said of the sum."""

    shows: bool = False  # it is not zero
    finding: Finding | None = None
    ambiguity: Ambiguity | None = None
    remark: str = ""


def sum_of(tones: Tones) -> Sum:
    """Gain, skew or neither."""
    i, total, omega = tones.i[:, 1], tones.total[:, 1], tones.omega
    energy = float(np.sum(np.abs(total) ** 2))
    size = float(np.sqrt(energy / np.sum(np.abs(i) ** 2)))
    noise = float(np.sqrt(np.sum(tones.noise**2) / np.sum(np.abs(i) ** 2)))
    if size < max(_SHOWS, _NOISE_FACTOR * noise):
        return Sum()
    gain, by_gain = _explained_share(i[:, None], total)
    _, by_both = _explained_share(np.column_stack([i, 1j * omega * i]), total)
    ratio = total / i
    low, high = ratio[0], ratio[-1]
    seen = (
        f"the measured phase currents do not sum to zero: {quantity(size, '1')} of the current, "
        f"{quantity(float(low.real), '1')} in phase with it at {tones.frequency[0]:g} Hz and "
        f"{quantity(float(high.real), '1')} at {tones.frequency[-1]:g} Hz"
    )
    which = "which sensor it is their sum does not say: each has an equal part in what is said here"
    if by_gain > _GAIN_SHARE:
        spread = float(np.std(ratio.real, ddof=1)) / np.sqrt(len(i))
        place = Place("in the sum of the phase currents", {}, by_gain, 1.0)
        sizes = {"gain_of_the_sum": Quantity(float(gain[0]), spread, "1")}
        rival = Rival("current_sampling_skew", ((1.0 - _skew(i, omega, total)) / max(1.0 - by_gain, 1e-6)) ** len(i))
        finding = Finding("current_sensor_gain", sizes, place, rival.odds, (rival,), {})
        return Sum(True, finding, None, f"{seen}; {which}")
    reason = (
        f"{seen}; one gain explains {quantity(by_gain, '1')} of that, gain and skew together {quantity(by_both, '1')}: "
        "neither is all of it"
    )
    return Sum(True, None, Ambiguity(("current_sensor_gain", "current_sampling_skew"), reason, _DC), which)


def _skew(i: Vector, omega: Array, total: Vector) -> float:
    return _explained_share((1j * omega * i)[:, None], total)[1]


def _explained_share(columns: Vector, total: Vector) -> tuple[Array, float]:
    """Real coefficients, and the share of a sum's energy that they explain."""
    A, y = np.vstack([columns.real, columns.imag]), np.concatenate([total.real, total.imag])
    c = cast(Array, np.linalg.lstsq(A, y, rcond=None)[0])
    return c, 1.0 - float(np.sum((y - A @ c) ** 2) / np.sum(y**2))
