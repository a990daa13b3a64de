"""Causes: the conventions that recordings follow instead of the expected one, and what each does to the columns.

Scales leave the flux balance as closed as it was; forms do not. Knows not which one is there.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Final

from estimator.diagnosis.intake.correction import MIRROR, PHASES, TURNS, TURNS_TO_DEGREES, Correction
from estimator.machine import PARAMETERS
from estimator.online.flux_balance import TURN

MOST_POLE_PAIRS: Final = 12
WARM: Final = 1.6  # times, by which a winding's warmth raises R_s

Values = tuple[float, float, float, float]  # R_s, L_d, L_q, psi_f
AS_GIVEN: Final[Values] = (1.0, 1.0, 1.0, 1.0)

_SQRT3: Final = math.sqrt(3.0)
_RMS: Final = math.sqrt(0.5)
_INVARIANT: Final = math.sqrt(1.5)


@dataclass(frozen=True, slots=True)
class Scale:
    """What multiplies voltages, currents and the period: recorded over expected. Or values of the machine file."""

    name: str
    says: str
    u: float = 1.0
    i: float = 1.0
    T_s: float = 1.0
    prior: float = 3.0  # log-odds that it must bring
    given: Values = AS_GIVEN  # R_s, L_d, L_q, psi_f of the machine file over what they should be

    @property
    def by(self) -> Values:
        """Times the nominal ones, as which R_s, L_d, L_q, psi_f come out."""
        Z, (R_s, L_d, L_q, psi_f) = self.u / self.i, self.given
        return Z / R_s, Z * self.T_s / L_d, Z * self.T_s / L_q, self.u * self.T_s / psi_f

    @property
    def of_machine(self) -> bool:
        """Whether it is the machine file that follows another convention."""
        return self.given != AS_GIVEN


@dataclass(frozen=True, slots=True)
class Cause:
    """What else may have been done to the columns."""

    name: str
    says: str
    correction: Correction
    prior: float = 3.0  # log-odds that it must bring
    pole_pairs: int | None = None  # the right ones, where they are not the nominal ones


NO_SCALE: Final = Scale("", "", prior=0.0)
NO_FORM: Final = Cause("", "", Correction(), prior=0.0)
DELAYS: Final = tuple(Cause("voltage_delay", "", Correction(u_shift=k), prior=0.0) for k in (1, -1))
"""Of one row: the library's `voltage_delay`, no convention."""

_SPEED_UNITS: Final = (
    (1.0, "rad/s", ""),
    (60.0 / TURN, "rpm", "2 pi/60"),
    (TURNS, "turns/s", "2 pi"),
    (TURNS_TO_DEGREES, "degrees/s", "pi/180"),
)
"""Units of a speed: what it is times in them, their names, and what makes rad/s of them."""
_TURNS_OF: Final = ((False, "electrical", ""), (True, "mechanical", "n_p "))
"""Whose turns: whether they are of the shaft, and what makes electrical ones of them."""

_FACTORS: Final = (
    (_SQRT3, "line_to_line", "line-to-line values, expected phase values"),
    (1.0 / _SQRT3, "over_sqrt_3", "1/sqrt(3) of the phase values, as line-to-line values converted twice"),
    (_RMS, "rms", "rms values, expected peak values"),
    (1.0 / _RMS, "sqrt_2", "sqrt(2) times the peak values, as rms values converted twice"),
    (_INVARIANT, "power_invariant", "scaled by sqrt(3/2), as by a power-invariant transformation"),
    (1.0 / _INVARIANT, "sqrt_two_thirds", "scaled by sqrt(2/3), as by a power-invariant transformation's inverse"),
    (1.5, "three_halves", "scaled by 3/2: a transformation's factor 2/3 is missing"),
    (1.0 / 1.5, "two_thirds", "scaled by 2/3: a transformation's factor 2/3 was applied twice"),
    (2.0, "twice", "twice what they are, as by a divider or a range that is taken for another"),
    (0.5, "half", "half of what they are, as by a divider or a range that is taken for another"),
)  # fmt: skip

SCALES: Final = (
    NO_SCALE,
    *(Scale(f"voltage_{name}", f"the voltages are {says}", u=factor) for factor, name, says in _FACTORS),
    *(Scale(f"current_{name}", f"the currents are {says}", i=factor) for factor, name, says in _FACTORS[2:]),
    *(Scale(name, f"voltages and currents are {says}", f, f, prior=5.0) for f, name, says in _FACTORS[2:]),
    Scale("line_to_line_and_rms", "the voltages are line-to-line peak values and the currents rms values, expected "
          "peak phase values", _SQRT3, _RMS, prior=5.0),
    Scale("line_to_line_rms", "the voltages are line-to-line rms values and the currents rms values, expected "
          "peak phase values", _INVARIANT, _RMS, prior=5.0),
    Scale("period_doubled", "the control period is given twice as long as it is", T_s=2.0),
    Scale("period_halved", "the control period is given half as long as it is", T_s=0.5),
)  # fmt: skip

_IMPEDANCES: Final[tuple[tuple[str, Values, str, str, float], ...]] = (
    ("terminal_values", (2.0, 2.0, 2.0, 1.0), "R_s, L_d and L_q of the machine file are twice the recording's",
     "are they from terminal to terminal? Per phase is half", 3.0),
    ("terminal_resistance", (2.0, 1.0, 1.0, 1.0), "R_s of the machine file is twice the recording's",
     "is it from terminal to terminal? Per phase is half", 3.0),
    ("terminal_inductances", (1.0, 2.0, 2.0, 1.0), "L_d and L_q of the machine file are twice the recording's",
     "are they from terminal to terminal? Per phase is half", 5.0),
    ("halved_values", (0.5, 0.5, 0.5, 1.0), "R_s, L_d and L_q of the machine file are half the recording's",
     "were they halved, as if they had been from terminal to terminal? Per phase is twice", 3.0),
    ("joined_terminals", (1.5, 1.5, 1.5, 1.0), "R_s, L_d and L_q of the machine file are 3/2 times the recording's",
     "are they from one terminal to the two others, joined? Per phase is 2/3", 3.0),
    ("delta", (3.0, 3.0, 3.0, 1.0), "R_s, L_d and L_q of the machine file are 3 times the recording's",
     "are they of one winding of a delta? Per phase of a star that acts alike is 1/3", 3.0),
)  # fmt: skip
"""Impedances as data sheets give them: over those of a phase, what is seen, what it is known for, log-odds to bring."""


_FLUXES_ALONE: Final[tuple[tuple[str, float, str, str], ...]] = (
    ("over_sqrt_3", 1.0 / _SQRT3, "1/sqrt(3) of", "was it divided by sqrt(3) twice? Once is sqrt(3) times"),
    ("sqrt_2", 1.0 / _RMS, "sqrt(2) times", "was it multiplied by sqrt(2) twice? Once is 1/sqrt(2)"),
    ("twice", 2.0, "twice", "is it a peak-to-peak constant? The peak one is half"),
)  # fmt: skip
"""As `_fluxes`, but where nothing else is off: beside impedances, another cause is the likelier."""
_FLUX_BESIDE: Final = (
    "line_to_line_rms", _INVARIANT, "sqrt(3/2) times",
    "is it a line-to-line rms constant? The peak one of a phase is sqrt(2/3)",
)  # fmt: skip
"""The same beside impedances: alone, warm magnets are nearly as far off."""


def _fluxes(n_p: int) -> Iterator[tuple[str, float, str, str]]:
    """psi_f as data sheets give it: over the peak one of a phase, that in words, what it is known for."""
    yield "line_to_line", _SQRT3, "sqrt(3) times", "is it a line-to-line constant? Per phase is 1/sqrt(3)"
    yield "rms", _RMS, "1/sqrt(2) of", "is it an rms constant? The peak one is sqrt(2) times"
    if n_p > 1:
        yield "per_mechanical_angle", n_p, f"{n_p} times", (
            f"is it per mechanical rad/s? Per electrical rad/s is 1/{n_p}, by the pole pairs"
        )
        yield "line_to_line_per_mechanical_angle", _SQRT3 * n_p, f"sqrt(3) times {n_p} times", (
            "is it a line-to-line constant per mechanical rad/s? Of a phase, per electrical rad/s, is "
            f"1/(sqrt(3) {n_p})"
        )
        yield "line_to_line_rms_per_mechanical_angle", _INVARIANT * n_p, f"sqrt(3/2) times {n_p} times", (
            "is it a line-to-line rms constant per mechanical rad/s? The peak one of a phase, per electrical rad/s, is "
            f"sqrt(2/3)/{n_p}"
        )
    yield "torque_constant", 1.5 * n_p, f"3/2 times {n_p} times", (
        f"is it a torque constant, Nm per peak A? psi_f is that over 3/2 and the pole pairs, {n_p}"
    )


def nominal_causes(n_p: int) -> tuple[Scale, ...]:
    """Conventions that a machine file may follow in place of peak values of a phase, per electrical rad/s."""
    impedances = [Scale(f"nominal_{name}", f"{seen}: {known}", prior=prior, given=given)
                  for name, given, seen, known, prior in _IMPEDANCES]  # fmt: skip
    found = [*impedances]
    alone, beside = _FLUXES_ALONE, (*_fluxes(n_p), _FLUX_BESIDE)
    if n_p > 1:
        known = f"was it divided by the {n_p} pole pairs twice? Once is {n_p} times"
        alone = (*alone, ("over_pole_pairs_twice", 1.0 / n_p, f"1/{n_p} of", known))
    for name, times, seen, known in (*_fluxes(n_p), *alone):
        says = f"psi_f of the machine file is {seen} the recording's: {known}"
        prior = 5.0 if (name, times, seen, known) in alone else 3.0
        found.append(Scale(f"nominal_flux_{name}", says, prior=prior, given=(1.0, 1.0, 1.0, times)))
    from_sheet = [one for one in impedances if one.given[1] > 1.0]
    for one, (name, times, seen, known) in product(from_sheet, beside):
        says = f"{one.says}; psi_f of the machine file is {seen} the recording's: {known}"
        both = (*one.given[:3], times)
        found.append(Scale(f"{one.name}_flux_{name}", says, prior=one.prior + 1.0, given=both))
    return tuple(found)


def bring_in_order(over_nominal: Mapping[str, float], n_p: int, tolerance: Mapping[str, float]) -> list[Scale]:
    """What brings all parameters within their tolerance, R_s but for warmth, likeliest first; none if they are.

    over_nominal: R_s, L_d, L_q, psi_f over the machine file's; tolerance: a share each.
    """
    found: list[tuple[float, Scale]] = []
    for one in (*nominal_causes(n_p), *SCALES):
        right = {name: over_nominal[name] / by for name, by in zip(PARAMETERS, one.by, strict=True)}
        most = {name: 1.0 + tolerance[name] for name in PARAMETERS}
        if one is NO_SCALE or one.by[1:] != AS_GIVEN[1:]:  # of which R_s is not all that tells
            most["R_s"] = max(most["R_s"], WARM)
        if all(1.0 - tolerance[name] <= right[name] <= most[name] for name in PARAMETERS):
            if one is NO_SCALE:
                return []
            off = sum((math.log(right[name]) / tolerance[name]) ** 2 for name in PARAMETERS if name != "R_s")
            found.append((one.prior + off, one))
    return [one for _, one in sorted(found, key=lambda each: each[0])]


def forms(n_p: int, *, per_unit: bool, by_speed: bool = False) -> tuple[Cause, ...]:
    """All forms that a recording of a machine with n_p pole pairs may have. `per_unit`: voltages may be. `by_speed`:
    the angle is the integral of the speed, and turns as that says.
    """
    always = (NO_FORM, *DELAYS, *_SIGNS, *_AXES, *_PHASE_ORDERS, *_LINE_QUANTITIES, *_ROWS)
    turning = _speeds(n_p) if by_speed else (*_ANGLES, *_pole_pairs(n_p))
    return (*always, *turning, *_PER_UNIT) if per_unit else (*always, *turning)


def _turn_by(degrees: float) -> complex:
    return complex(math.cos(math.radians(degrees)), math.sin(math.radians(degrees)))


_SIGNS: Final = (
    Cause("voltage_sign", "the voltages have the wrong sign", Correction(u=-1.0)),
    Cause("current_sign", "the currents have the wrong sign, expected positive into the machine", Correction(i=-1.0)),
    Cause("angle_sign", "the angle counts the other way than the phases follow each other, or both i_q and u_q have "
          "the wrong sign", Correction(theta=-1.0)),
)  # fmt: skip
_AXES: Final = (
    Cause("axes_swapped", "d and q are swapped in voltages and currents", Correction(1j, 1j, MIRROR, MIRROR)),
    Cause("voltage_axes_swapped", "u_d and u_q are swapped", Correction(u=1j, u_mirrored=MIRROR)),
    Cause("current_axes_swapped", "i_d and i_q are swapped", Correction(i=1j, i_mirrored=MIRROR)),
    Cause("u_q_sign", "u_q has the wrong sign", Correction(u_mirrored=MIRROR)),
    Cause("i_q_sign", "i_q has the wrong sign", Correction(i_mirrored=MIRROR)),
    Cause("u_d_sign", "u_d has the wrong sign", Correction(u=-1.0, u_mirrored=MIRROR)),
    Cause("i_d_sign", "i_d has the wrong sign", Correction(i=-1.0, i_mirrored=MIRROR)),
    *(Cause(f"axis_{name}", f"the d axis is {says}, expected on the magnets' flux",
            Correction(_turn_by(k), _turn_by(k)))
      for k, name, says in ((180.0, "opposite", "opposite to the magnets' flux"),
                            (90.0, "behind", "90 degrees behind the magnets' flux"),
                            (-90.0, "ahead", "90 degrees ahead of the magnets' flux"))),
)  # fmt: skip
_WHOSE: Final = (("current", "currents"), ("voltage", "voltages"), ("all", "voltages and currents"))


def _turned(whose: str, turn: complex, mirrored: int = 0) -> Correction:
    u, i = whose != "current", whose != "voltage"
    return Correction(turn if u else 1.0, turn if i else 1.0, mirrored if u else 0, mirrored if i else 0)


_PHASE_ORDERS: Final = (
    *(Cause(f"{whose}_phases_{phases}", f"phases {phases[0]} and {phases[1]} of the {says} are swapped",
            _turned(whose, _turn_by(degrees), PHASES))
      for whose, says in _WHOSE for phases, degrees in (("bc", 0.0), ("ab", 120.0), ("ac", -120.0))),
    *(Cause(f"{whose}_phases_{side}", f"the phases of the {says} are one place {side}",
            _turned(whose, _turn_by(degrees)))
      for whose, says in _WHOSE[:2] for side, degrees in (("ahead", 120.0), ("behind", -120.0))),
)  # fmt: skip
_LINE_QUANTITIES: Final = tuple(
    Cause(f"voltage_line_to_line{name}_{side}", f"the voltages are line-to-line {says} values, 30 degrees {side} of "
          "the phase values, expected peak phase values", Correction(u=factor * _turn_by(degrees)))
    for side, degrees in (("ahead", 30.0), ("behind", -30.0))
    for name, says, factor in (("", "peak", _SQRT3), ("_rms", "rms", _INVARIANT))
)  # fmt: skip
_ROWS: Final = tuple(
    Cause(f"voltage_2_rows_{late}", f"the voltages stand 2 rows too {low} in the file, expected in row k the voltage "
          "applied from row k to row k + 1", Correction(u_shift=k))
    for k, late, low in ((2, "late", "low"), (-2, "early", "high"))
)  # fmt: skip
ANGLE_ROWS: Final = {
    k: Cause(f"angle_{rows}_{late}", f"the angle stands {rows.replace('_', ' ')} too {low} in the file",
            Correction(theta_shift=k))
    for k, rows, late, low in ((1, "1_row", "late", "low"), (2, "2_rows", "late", "low"),
                               (-1, "1_row", "early", "high"), (-2, "2_rows", "early", "high"))
}  # fmt: skip
"""Hardly to be seen in the flux balance, but where phase currents were recorded."""

_ANGLES: Final = (
    Cause("angle_in_degrees", "the angle is in degrees, expected rad", Correction(theta=TURNS_TO_DEGREES)),
    Cause("angle_in_turns", "the angle is in turns, expected rad", Correction(theta=TURNS)),
)
_PER_UNIT: Final = tuple(
    Cause(f"voltage_per_unit_{name}", f"the voltages are in per unit of {says}, expected V", Correction(per_unit=base))
    for base, name, says in ((1.0, "u_dc", "u_dc"), (0.5, "half_u_dc", "u_dc/2"),
                             (1.0 / _SQRT3, "linear", "u_dc/sqrt(3)"), (2.0 / 3.0, "six_step", "2/3 u_dc"))
)  # fmt: skip


def _pole_pairs(n_p: int) -> tuple[Cause, ...]:
    """Angles that turn too slowly or too fast."""
    found: list[Cause] = []
    if n_p > 1:
        says = f"the angle is the mechanical one, expected the electrical one, {n_p} times as fast"
        found.append(Cause("mechanical_angle", says, Correction(theta=1.0 / n_p)))
        says = f"the angle was multiplied by the {n_p} pole pairs twice"
        found.append(Cause("angle_times_pole_pairs_twice", says, Correction(theta=n_p)))
    for right, what in _other_pole_pairs(n_p):
        says = f"the electrical angle was made with {what}"
        found.append(Cause(f"pole_pairs_{right}", says, Correction(theta=n_p / right), prior=5.0, pole_pairs=right))
    return tuple(found)


def _speeds(n_p: int) -> tuple[Cause, ...]:
    """Speeds in other units, and the angles that are their integrals."""
    found: dict[float, Cause] = {}
    for factor, unit, times in _SPEED_UNITS:
        for mechanical, turn, by in _TURNS_OF[: 2 if n_p > 1 else 1]:
            exact, makes = factor / n_p if mechanical else factor, f"{by}{times}".strip()
            says = f"omega_e is the {turn} speed in {unit}, expected the electrical one in rad/s, {makes} times that"
            name = f"speed_{turn}_{unit.replace('/', '_per_')}"
            if exact != 1.0:
                found.setdefault(round(exact, 9), Cause(name, says, Correction(theta=exact, omega=exact, whole=True)))
    for right, what in _other_pole_pairs(n_p):
        exact, says = n_p / right, f"the electrical speed was made with {what}"
        made = Correction(theta=exact, omega=exact, whole=True)
        found.setdefault(round(exact, 9), Cause(f"pole_pairs_{right}", says, made, prior=5.0, pole_pairs=right))
    return tuple(found.values())


def _other_pole_pairs(n_p: int) -> Iterator[tuple[int, str]]:
    """Pole pairs that a machine may have in place of n_p, and what was taken for them then."""
    likely = {*range(2, MOST_POLE_PAIRS + 1), n_p // 2, n_p - 1, n_p + 1}
    for right in sorted(k for k in likely if k > 1 and k not in (n_p, n_p * n_p)):
        yield right, "poles instead of pole pairs" if n_p == 2 * right else f"{n_p} pole pairs, the machine has {right}"


def speed_as(ratio: float, n_p: int, within: float) -> tuple[float, str] | None:
    """What a speed column holds that is `ratio` times the electrical speed in rad/s: the exact factor, and its name."""
    for factor, unit, _ in _SPEED_UNITS:
        for mechanical, turn, _ in _TURNS_OF:
            for sign, says in ((1.0, ""), (-1.0, ", with the wrong sign")):
                exact = sign * (factor / n_p if mechanical else factor)
                if ratio * sign > 0.0 and abs(math.log(ratio / exact)) < within:
                    return exact, f"{turn} and in {unit}{says}"
    return None
