"""Told machine: R_s, L_d, L_q, psi_f of a fit, with intervals, and what is said of them. Knows nothing of verdicts."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from estimator.diagnosis.answer.common_scale import scales_left_open
from estimator.diagnosis.likelihood.evidence import Choice, Search
from estimator.diagnosis.likelihood.given import Given
from estimator.diagnosis.likelihood.identifiability import at_its_bound, attenuated
from estimator.diagnosis.search.fitting import Fitted
from estimator.diagnosis.search.flux_map_fit import FluxMap, told_map
from estimator.diagnosis.verdict import Quantity, Range
from estimator.machine import PARAMETERS, UNITS
from estimator.physics.effect import BridgeError
from estimator.physics.library import of_kind
from estimator.physics.rows import Rows
from estimator.physics.vectors import by_phase
from estimator.twin.model import Model

_OUTSIDE_TOLERANCE: Final = 3.0  # standard errors, beyond the tolerance


class ToldMachine(NamedTuple):
    """R_s, L_d, L_q, psi_f and what is said of them."""

    before: dict[str, Quantity]
    after: dict[str, Quantity]
    flux_map: FluxMap | None
    outside: dict[str, str]  # their tolerance: by name, in a sentence
    unidentified: list[str]  # those that are not told
    scales: dict[str, Range]  # that are left open


def told_machine(found: Fitted, plain: Search | None, lent: float, given: Given) -> ToldMachine:
    """Of the fit without effects and with them. plain: without a flux map, where it has one.

    lent: energy over noise that what has no name may have lent to a parameter.
    """
    search, choice, scaled = found.search, found.choice, _scaled_by(found.smooth, found.model)
    after = _four_parameters(search, choice, lent, scaled)
    likely, compared, flux_map = _four_parameters(search, choice), list(PARAMETERS), None
    if found.model.bend is not None:
        flux_map = told_map(search, choice, lent)
        for name, told in flux_map.machine().items():
            std = None if told.value is None else math.hypot(told.std or 0.0, scaled * told.value)
            after[name] = replace(told, std=std)
        # Inductances of a data sheet are those of some current: a map's at no current need not be near them
        compared = [name for name in ("R_s", "psi_f") if after[name].value is not None]
    contact = _contact(found.model)
    return ToldMachine(
        _four_parameters(plain or search, ()), after, flux_map,
        _outside({name: after[name] for name in compared}, given, contact),
        _blind({name: likely[name] for name in compared}, given),
        scales_left_open(
            after, given.machine, given.tolerance, [name for name in compared if not contact or name != "R_s"]
        ),
    )  # fmt: skip


def _scaled_by(rows: Rows, model: Model) -> float:
    """Share by which effects may scale all voltages without a trace."""
    return math.hypot(*(bridge.scales(rows, sizes) for bridge, sizes in of_kind(BridgeError, model.effects)))


def _four_parameters(search: Search, choice: Choice, lent: float = 0.0, scaled: float = 0.0) -> dict[str, Quantity]:
    """R_s, L_d, L_q, psi_f of a fit; their intervals take in what noise of the currents may have made of them.

    And what equations of effects miss. `lent`: energy over noise that what has no name may have lent to a parameter: as
    much as it left. `scaled`: share by which all voltages may be scaled.
    """
    fit = search.fit(choice)
    covariance = search.free_covariance(choice) if search.regression.unidentified else fit.covariance
    variance = np.maximum(covariance.diagonal(), 0.0) * (search.parameter_scatter(fit) + lent)
    variance += search.form_covariance(choice).diagonal() + search.untold_covariance(choice).diagonal()
    variance = variance[: len(PARAMETERS)]
    variance += np.sum(attenuated(search, choice) ** 2, axis=0) + (scaled * fit.value[: len(PARAMETERS)]) ** 2
    held = covariance.diagonal() <= 0.0  # at a bound, which says nothing of how far off it is
    return {
        name: Quantity(float(fit.value[k]), None if held[k] else math.sqrt(float(variance[k])), UNITS[name])
        for k, name in enumerate(PARAMETERS)
    }


def _contact(model: Model) -> float:
    """What phases may have more than the one that has least, as by bad contacts, has added to R_s, ohm."""
    sizes = model.effects.get("phase_resistance_imbalance")
    return 0.0 if sizes is None else -min(by_phase(*sizes))


def _outside(after: Mapping[str, Quantity], given: Given, contact: float) -> dict[str, str]:
    """Parameters that lie outside their tolerance, each in a sentence. `contact`: ohm that R_s may be higher by.

    Those that are not told were held within it.
    """
    said: dict[str, str] = {}
    for name, quantity in after.items():
        if name in given.unidentified:
            continue
        nominal, tolerance = getattr(given.machine, name), given.tolerance[name]
        value, std = quantity.value, quantity.std or 0.0
        assert value is not None
        added = contact if name == "R_s" else 0.0
        if max(value - added - nominal, nominal - value) > tolerance * nominal + _OUTSIDE_TOLERANCE * std:
            off = 100.0 * abs(value / nominal - 1.0)
            said[name] = at_its_bound(name, value, given.machine) if quantity.std is None else (
                f"{name} = {value:.4g} {quantity.unit} lies {off:.2g} % from its nominal {nominal:.4g} "
                f"{quantity.unit}, beyond the tolerance of {100.0 * tolerance:.2g} %"
            )
    return said


def _blind(after: Mapping[str, Quantity], given: Given) -> list[str]:
    """Parameters that a recording does not tell."""
    return [
        name for name in after
        if (after[name].std or math.inf) > 0.5 * given.tolerance[name] * getattr(given.machine, name)
    ]  # fmt: skip
