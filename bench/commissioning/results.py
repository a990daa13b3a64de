"""What comes of a commissioning, as plain values: SI, as REST, reports and files have it."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, Final

from bench.commissioning.first_start import FirstStart
from bench.commissioning.identify import Identified
from bench.commissioning.loops import Judged, Loop
from bench.commissioning.response import Response
from bench.parameters.parameter_set import as_toml
from estimator.machine import PARAMETERS, UNITS
from estimator.mechanics.mechanics import Mechanics

_POINTS: Final = 300  # of a response


def first_started(found: FirstStart) -> dict[str, Any]:
    """Of a first start."""
    return asdict(found) | {"values": dict(found.values), "said": found.said}


def identified(found: Identified) -> dict[str, Any]:
    """Of an identification."""
    content, machine, loops = found.diagnosis, found.machine, found.loops
    after = content.get("machine", {}).get("after", {})
    return {
        "machine": None if machine is None else {
            "n_p": machine.n_p, **{name: {**after[name], "unit": UNITS[name]} for name in PARAMETERS}
        },
        "shaft": None if found.shaft is None else shaft_json(found.shaft),
        "acceleration": found.before.K,
        "loops": [one.as_json() for one in loops],
        "responses": responses(found.before.loops),
        "promises": promises(loops),
        "diagnosis": {
            "verdict": content.get("verdict"), "sentence": content.get("sentence"),
            "findings": [one.get("effect") for one in content.get("findings", [])],
        },
        "recordings": [path.stem for path in found.recordings],
        "set": as_toml(found.made.set),
        "present": {name: found.present[name] for name in found.made.set.entries if name in found.present},
        "remarks": list(found.made.remarks),
    }  # fmt: skip


def shaft_json(shaft: Mechanics) -> dict[str, Any]:
    """What is known of a shaft, as plain values."""
    return {
        "status": str(shaft.status), "sentence": shaft.sentence,
        "estimates": {
            name: {"value": one.value, "std": one.std, "unit": one.unit, "status": str(one.status)}
            for name, one in shaft.estimates.items()
        },
    }  # fmt: skip


def responses(loops: Sequence[Loop]) -> dict[str, Any]:
    """The mean steps of each loop, brought to 0 and 1; s."""
    return {loop.name: _response(loop.response) for loop in loops if loop.response is not None}


def promises(loops: Sequence[Judged]) -> dict[str, Any]:
    """What each loop's gains make of the same steps."""
    return {loop.name: _response(loop.promise) for loop in loops}


def _response(one: Response) -> dict[str, list[float]]:
    every = max(1, len(one.t) // _POINTS)
    return {"t": [round(float(x), 7) for x in one.t[::every]], "y": [round(float(x), 5) for x in one.y[::every]]}
