"""Witnesses in a diagnosis of every control period: priors of the machine, and what the recording says of them."""

from collections.abc import Mapping
from typing import Final

from estimator.diagnosis.answer.sentences import quantity, said_of_witness
from estimator.diagnosis.verdict import Quantity
from estimator.diagnosis.words import number
from estimator.interval import Z_95
from estimator.machine import UNITS
from estimator.witness import CONTRADICTS, Witness

_LEAST: Final = 1e-3  # share: the smallest tolerance


def tolerances(witnesses: Mapping[str, Witness]) -> dict[str, float]:
    """Shares by which they may be off."""
    return {name: max(Z_95 * one.std / one.value, _LEAST) for name, one in witnesses.items()}


def contradicting(machine: Mapping[str, Quantity], witnesses: Mapping[str, Witness]) -> dict[str, str]:
    """Those that the recording contradicts, a sentence each: what it says is what is left without the prior."""
    shares, found = tolerances(witnesses), dict[str, str]()
    for name, one in witnesses.items():
        size = machine.get(name)
        if size is None or size.value is None or not size.std:
            continue
        prior = shares[name] * one.value
        weight = 1.0 / size.std**2 - 1.0 / prior**2
        if weight <= 0.0:
            continue
        alone, std = (size.value / size.std**2 - one.value / prior**2) / weight, weight**-0.5
        if (apart := one.apart(alone, std)) > CONTRADICTS:
            found[name] = (
                f"the witness {said_of_witness(name, one)} contradicts the recording by {number(apart)} joint "
                f"standard errors and is not used: the recording alone says {quantity(alone, UNITS[name], std)}"
            )
    return found


def taken_in(witnesses: Mapping[str, Witness]) -> list[str]:
    """What is said of the others."""
    said = [said_of_witness(name, one) for name, one in witnesses.items()]
    return [f"the witness {one} stands in for the nominal value" for one in said]
