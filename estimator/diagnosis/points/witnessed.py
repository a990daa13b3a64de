"""Witnesses of the machine's sizes: one more row each in the fit of points, where they and the points agree."""

from collections.abc import Mapping
from typing import NamedTuple

from estimator.diagnosis.answer.sentences import quantity, said_of_witness
from estimator.diagnosis.points.fit import PointsFit
from estimator.diagnosis.points.problem import MACHINE, Key
from estimator.diagnosis.words import number
from estimator.machine import UNITS
from estimator.witness import CONTRADICTS, Witness


class Witnessed(NamedTuple):
    """A fit with witnesses, and what is said of each."""

    fit: PointsFit
    remarks: tuple[str, ...]
    against: tuple[str, ...]  # those that the rows contradict, a clause each


def witnessed(fit: PointsFit, witnesses: Mapping[str, Witness], names: Mapping[str, str] | None = None) -> Witnessed:
    """A fit, its doubts in it, with witnesses by parameter. `names`: what the fit calls one, where otherwise."""
    keys = {size.key for size in fit.sizes}
    used: dict[Key, Witness] = {}
    remarks, against = list[str](), list[str]()
    for name, one in witnesses.items():
        key, told = (MACHINE, (names or {}).get(name, name)), said_of_witness(name, one)
        if key not in keys:
            remarks.append(f"the witness {told} has no part in this: {name} is not asked for")
            continue
        value, std = fit.value(*key), fit.std(*key)
        alone, apart = f"these rows alone say {quantity(value, UNITS[name], std)}", one.apart(value, std)
        if apart > CONTRADICTS:
            against.append(
                f"the witness {told} contradicts these rows by {number(apart)} joint standard errors and is not used: "
                f"{alone}"
            )
        else:
            used[key] = one
            remarks.append(f"the witness {told} is one more row: {alone}")
    return Witnessed(fit.witnessed(used), tuple(remarks), tuple(against))
