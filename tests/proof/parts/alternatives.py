"""Others on the same recordings: one effect concealed in each, or none; what each method says of it."""

import json
import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bench.engineering import quantity
from emulator.conceal.files import answer_of, write
from emulator.conceal.recording import Choice, drawn
from emulator.scenario.motors import MOTORS
from estimator.diagnosis.diagnose import TOLERANCE, diagnose
from estimator.diagnosis.intake.prepared import prepared
from estimator.diagnosis.likelihood.evidence import Search
from estimator.diagnosis.search.fitting import fitted, moved
from estimator.interval import Z_95
from estimator.machine import PARAMETERS, UNITS, Machine
from estimator.samples import Samples
from estimator.twin.model import residual
from tests.proof.parts.rivals import (
    NOTHING_BEYOND,
    STRETCHES,
    M,
    Values,
    Word,
    black_box,
    blocks_of,
    ekf,
    rms,
    sparse,
    whiteness,
    wls,
)
from tests.proof.proof import Bar, Proof, Settings, Table
from tests.score.diagnosed import loaded
from tests.score.truth import EFFECT, truth_of

_CASES: Final = (
    "none", "dead_time", "saturation_q", "iron_loss", "none", "winding_heat", "flux_harmonics", "current_gain",
    "angle_offset", "eccentric_once", "cross_saturation", "skin", "stray_voltage", "drops",
)  # fmt: skip
_QUICK: Final = 2
_WINDOW: Final = (0.5, 1.0)  # of each class's range: sizes that are worth a look
_LENGTH: Final = 6.0  # s
_SURE: Final = 0.01  # p below which a residual is called not white
METHODS: Final = ("wls", "ekf", "sparse regression", "black box", "pmsm-bench")


@dataclass(frozen=True, slots=True)
class Compared:
    """A recording, and what all say of it."""

    recording: str
    concealed: str
    size: str
    machine: Mapping[str, float]  # true, SI
    p: float  # of whiteness
    words: Mapping[str, Word]  # by method
    floor: float  # V, noise of what is missed
    named: tuple[str, ...]  # by pmsm-bench
    verdict: str


def prove(settings: Settings) -> Proof:
    """Make recordings and hear all methods."""
    folder = settings.folder / "alternatives"
    folder.mkdir(parents=True, exist_ok=True)
    cases = [(settings.seed, number, kind, folder) for number, kind in enumerate(_CASES, 1)]
    cases = cases[: _QUICK if settings.quick else None]
    with ProcessPoolExecutor(settings.jobs, get_context("spawn")) as pool:
        compared = list(pool.map(_compared, cases))
    return proof_of(compared)


def _compared(case: tuple[int, int, str, Path]) -> Compared:
    seed, number, kind, folder = case
    choice = Choice(seed, (kind,), _WINDOW, tuple(MOTORS), _LENGTH)
    concealed, columns = drawn(choice, number)
    name = f"{number:04}"
    answer: dict[str, Any] = json.loads(json.dumps(answer_of(concealed, choice, name)))
    with TemporaryDirectory(dir=folder) as scratch:
        write(concealed, columns, choice, name, Path(scratch), Path(scratch))
        runs, nominal = loaded(Path(scratch), name)
    drive, blocks = concealed.scenario.drive, blocks_of(runs)
    lsb = drive.adc_full / 2.0 ** (drive.adc_bits - 1) if drive.adc_bits else 0.0
    window = wls(runs, blocks, nominal)
    ours, named, verdict, floor = _ours(runs, nominal)
    words = {
        "wls": window, "ekf": ekf(runs, blocks, nominal, max(drive.noise_i, 1e-6), lsb),
        "sparse regression": sparse(blocks, nominal), "black box": black_box(blocks, window.values, nominal),
        "pmsm-bench": ours,
    }  # fmt: skip
    size = ", ".join(quantity(one["value"], one["unit"]) for one in answer["sizes"].values())
    return Compared(
        name, kind, size, truth_of(answer).machine, whiteness(blocks, window.values, nominal), words, floor,
        named, verdict,
    )


def _ours(runs: Sequence[Samples], nominal: Machine) -> tuple[Word, tuple[str, ...], str, float]:
    """What the diagnosis says; what is missed by its model, fitted on the same stretches as others; the noise.

    Which effects the model has is decided on all stretches, as the diagnosis does it.
    """
    said = diagnose(runs, nominal)
    named = tuple(finding.effect for finding in said.findings)
    rows, given = prepared(runs, nominal, dict.fromkeys(PARAMETERS, TOLERANCE))
    found = fitted(rows, given)
    regression = found.search.regression
    model = moved(Search(replace(regression, gram=regression.gram[0::2])), found.choice)
    e = residual(rows, rows, model)
    edges = np.linspace(0, len(e), STRETCHES + 1).astype(int)
    missed: list[NDArray[np.complex128]] = []
    for a, b in zip(edges[1:-1:2], edges[2::2], strict=True):
        part = slice(a, a + (b - a) // M * M)
        whole = rows.joined[part].reshape(-1, M).all(axis=1)
        missed.append(e[part].reshape(-1, M)[whole].mean(axis=1))
    v = np.concatenate(missed)
    floor = math.sqrt((found.noise[0] ** 2 + found.noise[1] ** 2) / 2.0) * math.sqrt(2.0) / (M * rows.T_s)
    values: Values = {name: size.value for name, size in said.machine_after.items()}
    stds: Values = {name: size.std for name, size in said.machine_after.items()}
    says = ", ".join(named) or said.verdict.replace("_", " ")
    return Word(says, values, stds, rms(np.column_stack((v.real, v.imag)))), named, said.verdict, floor


# --- what it comes to


def proof_of(compared: Sequence[Compared]) -> Proof:
    """Tables, a row a recording."""
    there = [one for one in compared if one.concealed in EFFECT]
    none = [one for one in compared if one.concealed == "none"]
    found = sum(set(one.named) == {EFFECT[one.concealed]} for one in there)
    false = sum(bool(set(one.named) - {EFFECT.get(one.concealed, "")}) for one in compared)
    beyond = sum(one.words["sparse regression"].says != NOTHING_BEYOND for one in none)
    bars = (
        Bar("pmsm-bench: the concealed effect named, and nothing else", "", f"{found} of {len(there)}", None),
        Bar("pmsm-bench: a false name", "", f"{false} of {len(compared)}", None),
        Bar("conventional: an effect named", "", f"0 of {len(there)}: it has no names", None),
        Bar("whiteness test: concealed effects that are told as something", "", _of(_coloured(there), there), None),
        Bar("whiteness test: the same of recordings without an effect", "", _of(_coloured(none), none), None),
        Bar("sparse regression: terms beyond the textbook's where there is no effect", "", _of(beyond, none), None),
    )  # fmt: skip
    said = (
        f"{len(compared)} recordings of {_LENGTH:g} s with one effect each, or none, of sizes from the upper half of "
        "their ranges, drawn from the same population as the sealed suite. All methods are fitted on the same half of "
        "the stretches and judged on the other; but the Kalman filter, whose psi_f is held, sees all, and which "
        "effects the model of pmsm-bench has is decided on all. Least squares and the filter give values and standard "
        "errors; a whiteness test says whether something is left, neither what nor "
        "where; sparse regression gives terms, from a library of the machine's own terms and the shapes of dead time, "
        "saturation, iron loss and harmonics; boosted trees lower the residual and name nothing."
    )
    return Proof(
        name="alternatives", title="Alternatives on the same recordings", said=said, bars=bars,
        tables=(_saying(compared), _missing(compared), *_parameters(compared)),
    )  # fmt: skip


def _coloured(group: Sequence[Compared]) -> int:
    return sum(one.p < _SURE for one in group)


def _of(count: int, group: Sequence[Compared]) -> str:
    return f"{count} of {len(group)}"


def _saying(compared: Sequence[Compared]) -> Table:
    heads = ("", "concealed", "size", "wls, ekf", "whiteness test", "sparse regression", "black box", "pmsm-bench")
    rows = tuple(
        (
            one.recording, one.concealed, one.size, "values alone",
            f"not white, p {max(one.p, 1e-99):.0e}" if one.p < _SURE else f"white, p {one.p:.2f}",
            one.words["sparse regression"].says, one.words["black box"].says, one.words["pmsm-bench"].says,
        )
        for one in compared
    )  # fmt: skip
    return Table("What each says of what is concealed", heads, rows)


def _missing(compared: Sequence[Compared]) -> Table:
    rows = tuple(
        (one.recording, one.concealed, *(f"{one.words[name].missed / one.floor:.2f}" for name in METHODS))
        for one in compared
    )
    title = f"Voltage missed on what took no part in the fit, means of {M} periods, over the noise of the currents"
    return Table(title, ("", "concealed", *METHODS), rows)


def _parameters(compared: Sequence[Compared]) -> list[Table]:
    tables: list[Table] = []
    for name in PARAMETERS:
        methods = [method for method in METHODS if any(name in one.words[method].values for one in compared)]
        rows = tuple(
            (one.recording, one.concealed, quantity(one.machine[name], UNITS[name]),
             *(_off(one.words[method], name, one.machine[name]) for method in methods))
            for one in compared
        )  # fmt: skip
        title = f"Error of {name}, and half the 95 % interval that is told"
        tables.append(Table(title, ("", "concealed", "true", *methods), rows))
    return tables


def _off(word: Word, name: str, true: float) -> str:
    value, std = word.values.get(name), word.stds.get(name)
    if value is None:
        return "not told"
    told = f" ± {Z_95 * abs(std / true):.2%}" if std is not None and math.isfinite(std) else ""
    return f"{value / true - 1.0:+.2%}{told}"


