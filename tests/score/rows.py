"""One recording's score: what was said of it beside what it conceals."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from estimator.diagnosis.verdict import Diagnosis, Finding, Quantity, Unexplained, Verdict
from tests.score.diagnosed import Said
from tests.score.truth import EFFECT, Size, Truth

PLAIN: Final = 3.0  # limits: a size from which on an effect is to be found
TENTH: Final = 0.1  # of a size, allowed to be wrong
DEVIATIONS: Final = 2.0  # or so many standard errors
MACHINE: Final = 0.005  # of a parameter of the machine
FLOOR: Final = 1.05  # noise floors that a residual may have
DC_LINK: Final = "dc_link_gain"
_DOUBT: Final = (Verdict.AMBIGUOUS, Verdict.NOT_ENOUGH_EXCITATION)
_SLOW: Final = 50.0  # Hz: a telegraph's voltage is slower
_FAST: Final = 0.05  # of the sampling rate: a resonance is faster


@dataclass(frozen=True, slots=True)
class SizeScore:
    """A parameter of an effect that is there and was named."""

    true: float
    value: float | None
    std: float | None
    right: bool


@dataclass(frozen=True, slots=True)
class Row:
    """A recording's score."""

    recording: str
    kind: str  # none, one, two, three, stranger
    classes: tuple[str, ...]
    subjects: tuple[str, ...]  # as in `Truth`
    over_limit: Mapping[str, float]  # size over detection limit, by class
    found: tuple[str, ...]  # effects named
    ambiguous: tuple[tuple[str, ...], ...]
    verdict: str  # or "error"
    sentence: str
    exact: bool  # all effects that are there named, and nothing else
    missed: tuple[str, ...]
    false: tuple[str, ...]
    false_verdict: bool
    sizes: Mapping[str, SizeScore]  # "effect.parameter"
    before: Mapping[str, float | None]  # machine, relative error
    after: Mapping[str, float | None]
    deviations: Mapping[str, float]  # errors after, in standard errors
    residual: float | None  # held out, over the noise floor
    stranger: str  # "right", "elsewhere": unexplained without a name, "forced": into a name, "missed"; or ""
    region: str  # where the unexplained is said to be
    detectable: Mapping[str, float]  # limit that is told over the oracle's, by class
    gain_told: bool | None  # the dc link's gain is within the range that is told; None where there is none
    candidates: tuple[tuple[float, bool], ...]  # log10 of the odds that are told of an effect, and whether it is there
    seconds: float

    @property
    def plain(self) -> bool:
        """All that is there is large enough to be found."""
        return all(ratio >= PLAIN for ratio in self.over_limit.values())

    @property
    def all_told(self) -> bool:
        """All that is there is named and nothing else, but for a gain of the dc link, whose range is told."""
        return self.exact or (not self.false and self.missed == (DC_LINK,) and bool(self.gain_told))


def row_of(recording: str, truth: Truth, over_limit: Mapping[str, float], said: Said) -> Row:
    """The score of what was said of a recording."""
    found = said.diagnosis
    there = frozenset(truth.effects)
    named = tuple(finding.effect for finding in found.findings) if found else ()
    missed, false = tuple(sorted(there - set(named))), tuple(name for name in named if name not in there)
    exact = found is not None and not missed and not false
    return Row(
        recording=recording,
        kind=truth.kind,
        classes=truth.classes,
        subjects=truth.subjects,
        over_limit=over_limit,
        found=named,
        ambiguous=tuple(each.effects for each in found.ambiguous) if found else (),
        verdict=str(found.verdict) if found else "error",
        sentence=found.sentence if found else said.error,
        exact=exact,
        missed=missed,
        false=false,
        false_verdict=found is None or _is_false(found, truth, over_limit, exact),
        sizes=_sizes(found, truth),
        before=_off(found.machine_before if found else {}, truth.machine),
        after=_off(found.machine_after if found else {}, truth.machine),
        deviations=_deviations(found.machine_after if found else {}, truth.machine),
        residual=_residual(found),
        stranger=_stranger(found, truth) if truth.stranger else "",
        region=_told(found.unexplained) if found and found.unexplained else "",
        detectable=_detectable(found, truth, over_limit),
        gain_told=_gain_told(found, truth),
        candidates=tuple((each.log10_odds_after, each.effect in there) for each in found.candidates) if found else (),
        seconds=said.seconds,
    )


def _is_false(found: Diagnosis, truth: Truth, over_limit: Mapping[str, float], exact: bool) -> bool:
    """The verdict contradicts what is there. Doubt is honest, unless it leaves out what is there."""
    plain = any(ratio >= PLAIN for ratio in over_limit.values())
    if found.verdict is Verdict.NO_MISMATCH:
        return plain
    if found.verdict is Verdict.EXPLAINED:
        return not exact or truth.stranger is not None
    if found.verdict is Verdict.AMBIGUOUS:
        doubted = {effect for each in found.ambiguous for effect in each.effects}
        return not doubted & set(truth.effects)
    if found.verdict is Verdict.UNEXPLAINED:
        return truth.stranger is None
    named = {finding.effect for finding in found.findings}
    return found.verdict is Verdict.PARTLY_EXPLAINED and (truth.stranger is None or not named <= truth.effects.keys())


def _sizes(found: Diagnosis | None, truth: Truth) -> dict[str, SizeScore]:
    return {
        f"{finding.effect}.{name}": _size(finding, name, size)
        for finding in (found.findings if found else ())
        for name, size in truth.effects.get(finding.effect, {}).items()
    }


def _size(finding: Finding, name: str, size: Size) -> SizeScore:
    told = finding.parameters.get(name)
    if told is None or told.value is None:
        return SizeScore(size.value, None, None, False)
    allowed = max(TENTH * size.whole, DEVIATIONS * (told.std or 0.0))
    return SizeScore(size.value, told.value, told.std, abs(told.value - size.value) <= allowed)


def _off(told: Mapping[str, Quantity], machine: Mapping[str, float]) -> dict[str, float | None]:
    """Relative errors; None where nothing is said."""
    errors: dict[str, float | None] = {}
    for name, true in machine.items():
        value = told[name].value if name in told else None
        errors[name] = None if value is None else value / true - 1.0
    return errors


def _deviations(told: Mapping[str, Quantity], machine: Mapping[str, float]) -> dict[str, float]:
    """Errors in standard errors, where both are said."""
    known = {name: (told[name].value, told[name].std) for name in machine if name in told}
    return {name: abs(value - machine[name]) / std for name, (value, std) in known.items() if value is not None and std}


def _residual(found: Diagnosis | None) -> float | None:
    if found is None or found.fit is None or not found.fit.held_out or not found.fit.one_step_rms_V.noise_floor:
        return None
    return found.fit.one_step_rms_V.after / found.fit.one_step_rms_V.noise_floor


def _stranger(found: Diagnosis | None, truth: Truth) -> str:
    if found is None:
        return "missed"
    if any(finding.effect not in truth.effects for finding in found.findings):
        return "forced"
    if found.verdict not in (Verdict.UNEXPLAINED, Verdict.PARTLY_EXPLAINED) or found.unexplained is None:
        return "missed"
    return "right" if _is_there(found.unexplained, truth) else "elsewhere"


def _is_there(unexplained: Unexplained, truth: Truth) -> bool:
    """The region is the stranger's."""
    text, effects, T_s = _told(unexplained), truth.scenario.effects, truth.scenario.drive.T_s
    f = _frequency(unexplained)
    if truth.stranger == "stray_voltage":
        true = effects.stray.frequency
        near = f is not None and abs(f - true) <= max(0.05 * true, 1.0 / truth.length)
        return "stationary" in text and near
    if truth.stranger == "telegraph":
        in_time = any(words in text for words in ("burst", "comes and goes", "a step of", "telegraph"))
        return in_time or ("stationary" in text and f is not None and f <= _SLOW)
    return f is not None and f >= _FAST / T_s


def _told(unexplained: Unexplained) -> str:
    """All words of a region."""
    where = unexplained.where
    values = " ".join(f"{key} {value}" for key, value in where.region.items())
    return f"{unexplained.description} {where.sentence} {values}".lower()


def _frequency(unexplained: Unexplained) -> float | None:
    """Of the region, Hz; of a band its middle."""
    for key, value in unexplained.where.region.items():
        if key.startswith("frequency"):
            if isinstance(value, tuple):
                return 0.5 * (value[0] + value[1])
            if isinstance(value, float | int):
                return float(value)
    return None


def _detectable(found: Diagnosis | None, truth: Truth, over_limit: Mapping[str, float]) -> dict[str, float]:
    """By class, where the unit of what is told is one of the effect's parameters."""
    ratios: dict[str, float] = {}
    for name, ratio in over_limit.items():
        told = found.detectable.get(EFFECT.get(name, "")) if found else None
        sizes = truth.effects.get(EFFECT.get(name, ""), {})
        whole = next((size.whole for size in sizes.values() if told is not None and size.unit == told.unit), 0.0)
        if told is not None and told.value is not None and whole > 0.0:
            ratios[name] = told.value / (whole / ratio)
    return ratios


def _gain_told(found: Diagnosis | None, truth: Truth) -> bool | None:
    gain = truth.effects.get(DC_LINK, {}).get("gain")
    if gain is None:
        return None
    told = found.scales.get("voltages") if found else None
    return told is not None and told.least <= gain.value <= told.most


def as_json(row: Row) -> dict[str, Any]:
    """For a file."""
    sizes = {name: [size.true, size.value, size.std, size.right] for name, size in row.sizes.items()}
    keys = (
        "recording", "kind", "classes", "subjects", "over_limit", "found", "ambiguous", "verdict", "sentence", "exact",
        "missed", "false", "false_verdict", "before", "after", "residual", "stranger", "region", "detectable",
        "gain_told", "candidates", "seconds",
    )  # fmt: skip
    return {key: getattr(row, key) for key in keys} | {"sizes": sizes}
