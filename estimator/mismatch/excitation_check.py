"""Excitation check: whether the currents moved enough for what was fitted to mean anything.

Noise of a current is in the columns of L_d and L_q as well as in the voltage's residual. Where it is most of what they
hold, inductances come out low, the other parameters follow, and effects that are not there make up for it. Knows
nothing of what is recorded instead.
"""

import math
from collections.abc import Sequence
from typing import Final, cast

import numpy as np

from estimator.machine import PARAMETERS, UNITS, Machine
from estimator.mismatch.angle_rounding import lent_energy
from estimator.mismatch.columns import Array
from estimator.mismatch.explain import ENTRY, Choice, Search
from estimator.mismatch.words import number

_WEAK: Final = 40.0  # times the energy that noise alone gives a column: below, what lies far off is not believed
_LENT: Final = 12.0  # times what noise in the columns may lend an effect: below, it is not borne out
_ROUNDED: Final = 3.0  # times what rounding of the angle may leave
STANDING: Final = 5.0  # rad/s electrical: no slower is a speed


def poorly_told(search: Search, choice: Choice, nominal: Machine, outside: Sequence[str]) -> str | None:
    """What shows that this recording does not tell the machine, in a sentence's part; None where it does.

    `outside` says which parameters lie outside their tolerance.
    """
    fit = search.fit(choice)
    for name, value, variance in zip(PARAMETERS, fit.value, fit.covariance.diagonal(), strict=False):
        if variance <= 0.0:  # held at a bound
            return (
                f"{name} comes out at {number(float(value))} {UNITS[name]}, which no machine of nominally "
                f"{number(getattr(nominal, name))} {UNITS[name]} has"
            )
    axis, over_noise = min(_over_noise(search).items(), key=lambda item: item[1])
    if outside and over_noise < _WEAK:
        return f"i_{axis} changes by only {number(math.sqrt(over_noise), 2)} times its noise; {outside[0]}"
    return None


def not_borne_out(search: Search, choice: Choice, blind: Sequence[str]) -> tuple[Choice, str]:
    """Effects that noise of the currents alone may look like, or an encoder's rounding; and why, in a sentence's part.

    Noise in a column shifts its coefficient by its share of the column's energy, and that leaves as much of the signal.
    What leans on an effect that is not borne out is judged without it. `blind` are parameters that are not told.
    """
    over_noise = _over_noise(search)
    rows, noise = search.regression.rows, search.regression.noise
    lent = sum(len(rows) / max(ratio, 1.0) for ratio in over_noise.values())
    by_angle = max(_ROUNDED * lent_energy(rows) / (noise[0] * noise[1]), 1e-300)
    axis, least = min(over_noise.items(), key=lambda item: item[1])
    untold = [name for name in blind if name == "R_s" or name[-1] in over_noise or len(over_noise) > 1]
    if choice and len(untold) > 1:
        return choice, (
            f"this recording does not tell {' and '.join(untold)}, and at one level effects and the machine's "
            "parameters look alike"
        )
    left = choice
    while left:
        worth = {one: min(_explained(search, left, one) / (_LENT * lent), _gained(search, left, one) / by_angle)
                 for one in left}  # fmt: skip
        weakest = min(left, key=lambda one: worth[one])
        if worth[weakest] > 1.0:
            break
        left = tuple(one for one in left if one != weakest)
    fit = search.fit(choice)
    near = {one: distance for one in choice if (distance := search.distance(fit, one)) < ENTRY}
    if len(left) == len(choice):
        errors = math.sqrt(2.0 * min(near.values(), default=0.0))
        why = f"what is found of it lies {number(errors, 2)} standard errors from none"
    elif by_angle > _LENT * lent:
        why = "each period turns the rotor by nearly whole counts of its encoder, whose rounding may look like this"
    else:
        why = (
            f"i_{axis} changes by {number(math.sqrt(least), 2)} times its noise here, and noise of the currents alone "
            "may look like this"
        )
    return tuple(one for one in choice if one not in left or one in near), why


def _gained(search: Search, choice: Choice, one: tuple[str, int]) -> float:
    """Energy that nothing else of a set would explain, over that of the noise."""
    return search.fit(tuple(other for other in choice if other != one)).chi2 - search.fit(choice).chi2


def _explained(search: Search, choice: Choice, one: tuple[str, int]) -> float:
    """Energy of an effect's signal, less what the machine's parameters make of it, over that of the noise."""
    fit, own, base = search.fit(choice), search.sizes_of(one), search.base
    value = fit.value[[fit.places.index(j) for j in own]]
    inner = search.gram[:-1, :-1]
    A = inner[np.ix_(base, base)] + np.diag(search.weight[base])
    across = inner[np.ix_(base, own)] @ value
    return float(value @ inner[np.ix_(own, own)] @ value - across @ cast(Array, np.linalg.solve(A, across)))


def _over_noise(search: Search) -> dict[str, float]:
    """By axis, the energy of the inductance's column over what noise of the current alone would give it.

    An axis without current does not matter as long as the motor stands.
    """
    rows = search.regression.rows
    base = search.fit(())
    found: dict[str, float] = {}
    for axis in "dq":
        place = PARAMETERS.index(f"L_{axis}")
        energy = 1.0 / max(float(base.covariance[place, place]), 1e-300) - float(search.weight[place])
        L = getattr(rows.machine, f"L_{axis}")
        found[axis] = max(energy, 0.0) * L**2 / len(rows)
    if float(np.quantile(np.abs(rows.omega_e), 0.98)) < STANDING:
        axis = max(found, key=lambda name: found[name])
        return {axis: found[axis]}
    return found
