"""Numbers of several recordings: whether they are one number, and which.

Of independent recordings, with values x_r and standard errors s_r,

    x = sum_r x_r / s_r^2 / sum_r 1 / s_r^2           chi^2 = sum_r (x_r - x)^2 / s_r^2

(W. G. Cochran, The combination of estimates from different experiments, Biometrics 10(1), 1954). What an equation
misses is alike in all of them, and does not get less by their number. Knows nothing of machines and effects.
"""

import math
from collections.abc import Sequence
from typing import Final

from estimator.diagnosis.together.said import Shared
from estimator.diagnosis.verdict import Quantity

FALSE_ALARM: Final = 0.01
"""How often one of all the numbers that two alike recordings tell is said to differ."""
SEEN: Final = 3.0
"""Standard errors, beyond which one size is seen."""


def shared(each: Sequence[Quantity | None], numbers: int, common: float = 0.0) -> Shared:
    """What recordings tell of one of so many numbers; `common`: standard error that all of them have alike."""
    told = [(one.value, one.std) for one in each if one is not None and one.value is not None and one.std]
    unit = next((one.unit for one in each if one is not None), "1")
    if not told:
        return Shared(tuple(each), Quantity(None, None, unit), True)
    own = [math.sqrt(max(std**2 - common**2, (1e-3 * std) ** 2)) for _, std in told]
    weight = [std**-2 for std in own]
    mean = sum(w * value for w, (value, _) in zip(weight, told, strict=True)) / sum(weight)
    chi2 = apart([(value, std) for (value, _), std in zip(told, own, strict=True)])
    alike = len(told) < 2 or _by_chance(chi2, len(told) - 1) > FALSE_ALARM / numbers
    return Shared(tuple(each), Quantity(mean, math.hypot(sum(weight) ** -0.5, common), unit), alike)


def _by_chance(chi2: float, degrees: int) -> float:
    """How often chance makes at least as much."""
    from scipy.special import chdtrc

    return float(chdtrc(degrees, chi2))


def apart(told: Sequence[tuple[float, float]]) -> float:
    """Chi square of values, with their standard errors, around what they have in common; of fewer than two zero."""
    weight = [std**-2 for _, std in told]
    mean = sum(w * value for w, (value, _) in zip(weight, told, strict=True)) / max(sum(weight), 1e-300)
    return sum(w * (value - mean) ** 2 for w, (value, _) in zip(weight, told, strict=True))


def one_number(stds: Sequence[float], prior: float) -> float:
    """Log-odds that values of such standard errors are one, against one each, where they are exactly alike.

    Each of its own would be anywhere within a normal prior, p: the evidences of n values at the middle of it, one
    number or n, differ by sum_r log sqrt(1 + p^2 / s_r^2) - log sqrt(1 + p^2 sum_r 1 / s_r^2).
    """
    weight = [(prior / std) ** 2 for std in stds]
    return 0.5 * (sum(map(math.log1p, weight)) - math.log1p(sum(weight)))
