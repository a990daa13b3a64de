"""Rows: what every effect's equation is made of - currents, angle and voltage of a run, period by period.

n control periods lie between n + 1 samples. Quantities at samples have n + 1 values, those of periods n. Complex
vectors are amplitude-invariant and in the rotor frame; those of a period in the frame of its middle. What is derived
from rows is worked out once, goes along with stretches of them, and stays with rows of which only other things have
changed: see `derived`. Knows no effect.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Concatenate, Final, ParamSpec, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Array, Bools, Vector
from estimator.kernel import kernel
from estimator.machine import Machine
from estimator.physics.derived import Derived, derived
from estimator.physics.pulses import add_mean_of_pulses, duties_of, moments_of_pulses, powers_of_pulses
from estimator.physics.vectors import AXES, Stiffness
from estimator.samples import Samples, nearest_turns

T = TypeVar("T")
P = ParamSpec("P")

_NO_SENSOR: Final = 1e-4  # of the current: no three sensors agree that closely
_FOLLOWED_PERIODS: Final = 10  # periods that are not there
_TIME = ("t", "steps", "T_s")
_PULSES = ("u", "u_dc", "theta_e", "half")


@dataclass(frozen=True, slots=True, eq=False)
class LocalLine:
    """Straight lines that a saturating machine follows for a while, and its own curve."""

    of_periods: Stiffness
    psi_0: Vector  # Vs of each period, at no current of its line
    at_samples: Stiffness
    psi: Vector  # Vs at samples


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """A run without gaps, or a stretch of it."""

    machine: Machine  # the best that is known now
    T_s: float  # s
    i_rated: float  # A, peak
    t: Array  # s, at samples
    i: Vector  # A, at samples
    theta_e: Array  # rad, at samples, unwrapped
    half: Vector  # exp(j D/2) of each period, D the angle turned in it
    u: Vector  # V, of each period
    joined: Bools  # of each period: its two samples are of one run
    u_dc: Array | None  # V, of each period
    zero: Array | None  # A, mean of the three measured phase currents at samples, where they are known
    heat: Array  # A^2 s, integral of the squared current up to each sample
    span: tuple[float, float]  # s, start and length of the recording
    angle_step: float = 0.0  # rad, resolution of the angle, where it has one
    angle_turned: float = 1.0  # share of its rounding, by which the drive turned the currents
    hall_place: float | None = None  # rad, where the edges of Hall sensors are, modulo 60 deg, where the angle has such
    turned_by: Array | float = 0.0  # rad at samples, by which the angle was further when the drive turned by it
    angle_error: float = 0.0  # rad, rms, that the angle's rounding leaves of it: it looks like movement
    rounding: Array | float = 0.0  # rad at samples, of the angle, where it stays because currents' noise is louder
    fast_stiffness: float = 0.0  # 1/H, by which a current changes faster within a period than by the inductances
    fast_resistance: float = 0.0  # ohm, by which what changes within a period drops more than by R_s
    curvature: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)  # a_d, a_q, c, e_d of the curve, A/Vs^3
    R_s_ratio: Array | float = 1.0  # of each period: R_s over that at the start
    R_s_excess: tuple[float, float] = (0.0, 0.0)  # ohm, alpha and beta, by which phases have more; see `by_phase`
    psi_f_ratio: Array | float = 1.0  # at samples: psi_f over that at the start
    heat_beside: Array | float = 0.0  # A^2 s, what effects add to heat
    emf: Vector | float = 0.0  # V at samples, that effects take from what drives the current between pulses
    steps: NDArray[np.intp] | None = None  # control periods from each sample to the next, where `t` does not tell
    local: LocalLine | None = None  # of a machine that saturates
    lost: Vector | None = None  # V of each period, that the bridge loses and terminals do not see
    others: Vector | None = None  # V of each period, that effects other than the bridge's add
    hums: float = 50.0  # Hz, at which currents or voltages may hum
    sampled: Vector | None = None  # A at samples, stationary frame, as the drive took them, noise and all
    left: Vector | None = None  # V of each period, that the nominal machine leaves of the recorded one
    _known: dict[tuple[Any, ...], Any] = field(default_factory=dict[tuple[Any, ...], Any], init=False, repr=False)
    _latest: dict[Any, tuple[Any, ...]] = field(default_factory=dict[Any, tuple[Any, ...]], init=False, repr=False)

    def __len__(self) -> int:
        """Control periods."""
        return len(self.u)

    def __getitem__(self, periods: slice) -> "Rows":
        """A stretch of consecutive periods (views)."""
        n = len(self)
        a, b, _ = periods.indices(n)
        return self.taken(lambda whole: whole[a : b + (len(whole) - n)])

    def taken(self, take: Callable[[Any], Any]) -> "Rows":
        """Some periods, by what takes theirs from an array of all periods or of all samples."""

        def of(whole: Any) -> Any:
            if isinstance(whole, np.ndarray):
                return take(whole)
            if isinstance(whole, Stiffness):
                return Stiffness(take(whole.a), take(whole.b))
            if isinstance(whole, LocalLine):
                return LocalLine(of(whole.of_periods), take(whole.psi_0), of(whole.at_samples), take(whole.psi))
            return tuple(of(each) for each in cast(tuple[Any, ...], whole)) if isinstance(whole, tuple) else whole

        some = {each.name: of(getattr(self, each.name)) for each in fields(self) if each.init}
        found = Rows(**some)
        found._known.update({key: of(value) for key, value in self._known.items()})
        return found

    # --- what is derived

    def once(self, make: Callable[Concatenate["Rows", P], T], *args: P.args, **kwargs: P.kwargs) -> T:
        """What a function makes of these rows, worked out at its first call; stretches taken later have their part.

        Arrays of periods or of samples, or tuples of such.
        """
        key = (make, *args, *kwargs.items())
        if key not in self._known:
            self._known[key] = make(self, *args, **kwargs)
        return self._known[key]

    def latest(self, make: Callable[Concatenate["Rows", P], T], *args: P.args, **kwargs: P.kwargs) -> T:
        """What a function makes of these rows, of any kind: only what was made last is kept."""
        given = (*args, *kwargs.items())
        known = self._latest.get(make)
        if known is None or known[0] != given:
            known = self._latest[make] = given, make(self, *args, **kwargs)
        return known[1]

    def let_go(self) -> None:
        """Free what `latest` keeps."""
        self._latest.clear()

    def changed(self, **changes: Any) -> "Rows":
        """The rows with other values of some fields, and what has been derived from none of these."""
        found, names = replace(self, **changes), set(changes)
        if "machine" in changes and changes["machine"].n_p == self.machine.n_p:
            names.add("parameters")
        else:
            names |= {"parameters", "n_p"} if "machine" in changes else set()
        found._known.update({
            key: value for key, value in self._known.items()
            if isinstance(key[0], Derived) and not key[0].of & names
        })  # fmt: skip
        return found

    def knowing(self, known: Mapping[Derived[Any], Any]) -> "Rows":
        """These rows, told what is derived from them."""
        self._known.update({(each,): value for each, value in known.items()})
        return self

    def turned(self, by: Vector | complex, **changes: Any) -> "Rows":
        """The rows with other values of some fields, by which all vectors of periods are `by` (of length 1) times what
        they were: what has been derived from pulses turns with them.
        """
        found = self.changed(**changes)
        for key, value in self._known.items():
            turns = key[0].turns if isinstance(key[0], Derived) else None
            if turns is not None:
                found._known[key] = value * by**turns if turns else value
        return found

    def copy(self) -> "Rows":
        """The rows: what is worked out of the copy is not kept here."""
        found = replace(self)
        found._known.update(self._known)
        return found

    def prepare(self) -> None:
        """Work out now what all models share."""
        _ = self.D, self.speed, self.rotor, self.middle, self.turn, self.i_s
        if self.u_dc is not None:
            _ = self.moment_of_pulses, self.power_of_pulses

    # --- time

    @property
    def apart(self) -> NDArray[np.intp]:
        """Control periods from each sample to the next."""
        if self.steps is not None:
            return self.steps
        steps: Array = np.rint(np.diff(self.t) / self.T_s)
        return steps.astype(np.intp)

    @property
    def pauses(self) -> Bools:
        """Of each period: it is none, but a time over which a rotor cannot be followed; then another run begins."""
        return ~self.joined & ((self.apart > _FOLLOWED_PERIODS) | (self.apart < 1))

    @derived("span", *_TIME)
    def clock(self) -> Array:
        """Time at samples from the recording's start, s; by the periods between them, where `t` does not tell."""
        if self.steps is None:
            return self.t - self.span[0]
        periods = np.concatenate((np.zeros(1, np.intp), np.cumsum(self.steps)))
        return self.T_s * periods.astype(np.float64)

    # --- angles

    @derived("theta_e")
    def D(self) -> Array:
        """Angle turned in each period, rad."""
        return np.diff(self.theta_e)

    @property
    def omega_e(self) -> Array:
        """Electrical speed in each period, rad/s."""
        return self.D / self.T_s

    @derived("theta_e", *_TIME)
    def speed(self) -> Array:
        """Electrical speed at samples, rad/s: the mean of the periods before and after; over a gap none is known."""
        return self._at_samples(self.omega_e)

    @property
    def omega_of_rotor(self) -> Array:
        """Electrical speed in each period, rad/s, of a rotor that does not go by counts."""
        return np.diff(self.theta_e - self.rounding) / self.T_s

    @derived("theta_e", "rounding", *_TIME)
    def speed_of_rotor(self) -> Array:
        """Electrical speed at samples, rad/s, of a rotor that does not go by counts."""
        return self._at_samples(self.omega_of_rotor) if isinstance(self.rounding, np.ndarray) else self.speed

    def _at_samples(self, omega: Array) -> Array:
        there = self.apart == 1
        omega = np.where(there, omega, 0.0)
        periods = np.concatenate((there[:1], there)).astype(int) + np.concatenate((there, there[-1:]))
        return (np.concatenate((omega[:1], omega)) + np.concatenate((omega, omega[-1:]))) / np.maximum(periods, 1)

    @derived("theta_e")
    def rotor(self) -> Vector:
        """exp(j theta_e) at samples."""
        return np.exp(1j * self.theta_e)

    @derived("theta_e", "half")
    def middle(self) -> Vector:
        """exp(j theta_e) in the middle of each period."""
        return self.rotor[:-1] * self.half

    @derived("theta_e")
    def six(self) -> Vector:
        """exp(6j theta_e) at samples."""
        return _sixth_power(self.rotor)

    @derived("theta_e", "n_p")
    def turn(self) -> Vector:
        """exp(j theta_m) at samples."""
        return np.exp(1j * self.theta_m)

    @property
    def theta_m(self) -> Array:
        """Mechanical angle at samples, rad, but for a constant of each run: in a pause nobody counts turns."""
        return self.theta_e / self.machine.n_p

    # --- currents

    @derived("i", "theta_e")
    def i_s(self) -> Vector:
        """Current at samples in the stationary frame, A."""
        return self.i * self.rotor

    @property
    def sampled_i_s(self) -> Vector:
        """As the drive took it, which may be more than what is known of it now."""
        return self.i_s if self.sampled is None else self.sampled

    def phase(self, k: int) -> Array:
        """Current of phase k at samples, A."""
        return (self.i_s * AXES[k].conjugate()).real

    @derived("parameters", "i", *_PULSES, *_TIME)
    def i_mean(self) -> Vector:
        """Mean current of each period, A, in the machine without effects."""
        return self.mean_current(self.flux(self.i), self.stiffness)

    def mean_current(self, psi: Vector, g: Stiffness) -> Vector:
        """Mean current (A) of each period, for flux linkages (Vs) and their stiffness at samples.

        The cubic through both ends and their slopes by u - R_s i - j omega psi, at the speed there: a light rotor's
        changes within a period. And what pulses add. The flux linkage's
        ripple under them has no mean, but a first moment M = mean of (t - middle) times ripple, T^2/24 u_dc d (1 - d^2)
        per phase. It drives a decay, which lets the mean rise by g R_s g M; and a rotor with L_d other than L_q turns
        in it, which adds 2 j omega g_b conj(M).
        """
        R_s = float(self.machine.R_s)
        mean = _mean_currents(self.i, self.half, self.u, self.speed, self.T_s, R_s, psi, g.a, g.b)
        if self.u_dc is not None:
            add_mean_of_pulses(mean, self.moment_of_pulses, self.D, self.T_s, R_s, g.a, g.b)
        return mean

    def bent(self, v_0: Vector, v_1: Vector) -> Vector:
        """Mean current (A) of each period that a voltage (V, at its two ends) adds, where it makes a bend."""
        e, g = self.half, self.stiffness
        return self.T_s / 12.0 * (e * g[1:](v_1) - e.conj() * g[:-1](v_0))

    @derived(*_PULSES, "T_s", turns=1)
    def moment_of_pulses(self) -> Vector:
        """First moment (Vs s) of the flux linkage's ripple in each period. Needs `u_dc`."""
        assert self.u_dc is not None
        return moments_of_pulses(self.duties, self.u_dc, self.middle, self.T_s)

    @property
    def power_of_pulses(self) -> tuple[Array, Vector]:
        """Means of abs(ripple)^2 and ripple^2 of the flux linkage (Vs^2) in each period. Needs `u_dc`."""
        return self._size_of_pulses, self._square_of_pulses

    @derived(*_PULSES, "T_s", turns=0)
    def _size_of_pulses(self) -> Array:
        return self._powers_of_pulses[0]

    @derived(*_PULSES, "T_s", turns=2)
    def _square_of_pulses(self) -> Vector:
        return self._powers_of_pulses[1]

    @derived(*_PULSES, "T_s")
    def _powers_of_pulses(self) -> tuple[Array, Vector]:
        assert self.u_dc is not None
        return powers_of_pulses(self.duties, self.u_dc, self.middle, self.T_s)

    # --- model

    @property
    def stiffness(self) -> Stiffness:
        """Of the machine without effects, at samples."""
        m, n = self.machine, len(self.i)
        b = np.full(n, 0.5 * (1.0 / m.L_d - 1.0 / m.L_q), np.complex128)
        return Stiffness(np.full(n, 0.5 * (1.0 / m.L_d + 1.0 / m.L_q)), b)

    def flux(self, i: Vector) -> Vector:
        """Flux linkage (Vs) of the machine at a current (A)."""
        m = self.machine
        return _flux_of(i, float(m.L_d), float(m.L_q), float(m.psi_f))

    @property
    def local_line(self) -> tuple[Stiffness, Vector]:
        """Stiffness and flux at no current (Vs) of the straight lines that each period's flux linkages go along."""
        return self._everywhere if self.local is None else (self.local.of_periods, self.local.psi_0)

    @derived("parameters")
    def _everywhere(self) -> tuple[Stiffness, Vector]:
        """Those of the machine without effects."""
        m, n = self.machine, len(self)
        a, b = 0.5 * (1.0 / m.L_d + 1.0 / m.L_q), complex(0.5 * (1.0 / m.L_d - 1.0 / m.L_q))
        return Stiffness(np.full(n, a), np.full(n, b)), np.full(n, complex(m.psi_f))

    @property
    def own_flux(self) -> tuple[Vector, Stiffness]:
        """Flux linkage (Vs) of the machine, which may bend, and its stiffness at samples."""
        return (self.flux(self.i), self.stiffness) if self.local is None else (self.local.psi, self.local.at_samples)

    def flux_of_little(self, i: Vector) -> Vector:
        """Flux linkage (Vs) that the machine, which may bend, has less where a current (A, at samples) flows beside it.

        By its stiffness half way along the saturation curve.
        """
        if self.local is None:
            return self.machine.L_d * i.real + 1j * self.machine.L_q * i.imag
        psi, g = self.own_flux
        less = g.flux(i)
        if any(self.curvature):
            less = (g - self._change_of_stiffness(psi, psi - 0.5 * less)).flux(i)
        return less

    def _change_of_stiffness(self, psi: Vector, other: Vector) -> Stiffness:
        """From one flux linkage (Vs) to another along the saturation curve."""
        a_d, a_q, c, e_d = self.curvature
        magnets = self.machine.psi_f * self.psi_f_ratio
        d, q = psi.real**2 - other.real**2, psi.imag**2 - other.imag**2
        around = (psi.real - magnets) ** 2 - (other.real - magnets) ** 2
        dd, qq = 3.0 * (a_d * d + e_d * around) + c * q, 3.0 * a_q * q + c * d
        dq = 2.0 * c * (psi.real * psi.imag - other.real * other.imag)
        return Stiffness(0.5 * (dd + qq), 0.5 * (dd - qq) + 1j * dq)

    def with_local_line(self, psi: Vector, g: Stiffness) -> "Rows":
        """The rows with flux linkages (Vs, at samples) that are no straight lines, of such stiffness."""
        b, mean, i = (0.5 * (x[1:] + x[:-1]) for x in (g.b, psi, self.i))
        middle = Stiffness(0.5 * (g.a[1:] + g.a[:-1]), b)
        return self.changed(local=LocalLine(middle, mean - middle.flux(i), g, psi), lost=None, others=None)

    def with_machine(self, machine: Machine) -> "Rows":
        """The rows, to be seen with another machine, which does not saturate."""
        if self.machine == machine:
            return self
        return self.changed(machine=machine, local=None, lost=None, others=None)

    def with_currents(self, i: Vector) -> "Rows":
        """The rows with other currents (A) of a machine that does not saturate."""
        return self.changed(i=i, local=None, lost=None, others=None)

    # --- bridge

    @derived(*_PULSES, turns=0)
    def duties(self) -> Array:
        """Share of each period that the three legs are high, (n, 3), by space-vector modulation. Needs `u_dc`."""
        assert self.u_dc is not None
        return duties_of(self.u * self.middle, self.u_dc)

    # --- balances

    def balance(self, psi: Vector | Array) -> Vector:
        """Voltage (V) of each period that changes a flux linkage (Vs, at samples) as the rotor turns."""
        return _balance(self.half, psi, 1.0 / self.T_s)

    def stationary(self, v: Vector) -> Vector:
        """A vector of each period, given in the stationary frame, in the rotor frame."""
        return v * self.middle.conj()


@kernel
def _flux_of(i: Vector, L_d: float, L_q: float, psi_f: float) -> Vector:
    psi = np.empty(len(i), np.complex128)
    for k in range(len(i)):
        psi[k] = complex(L_d * i[k].real + psi_f, L_q * i[k].imag)
    return psi


@kernel
def _balance(half: Vector, psi: Vector | Array, rate: float) -> Vector:
    v = np.empty(len(half), np.complex128)
    for k in range(len(half)):
        v[k] = (half[k] * psi[k + 1] - half[k].conjugate() * psi[k]) * rate
    return v


@kernel
def _mean_currents(
    i: Vector, half: Vector, u: Vector, speed: Array, T_s: float, R_s: float, psi: Vector, g_a: Array, g_b: Vector
) -> Vector:  # fmt: skip
    mean = np.empty(len(u), np.complex128)
    for k in range(len(u)):
        s_0 = slope_of(i[k], u[k] * half[k], speed[k], R_s, psi[k], g_a[k], g_b[k])
        back = half[k].conjugate()
        s_1 = slope_of(i[k + 1], u[k] * back, speed[k + 1], R_s, psi[k + 1], g_a[k + 1], g_b[k + 1])
        mean[k] = mean_between(i[k], i[k + 1], s_0, s_1, half[k], T_s)
    return mean


@kernel
def slope_of(i: complex, u: complex, omega: float, R_s: float, psi: complex, g_a: float, g_b: complex) -> complex:
    """How fast the current changes under a voltage, A/s."""
    v = u - R_s * i - 1j * omega * psi
    return g_a * v + g_b * v.conjugate() + 1j * omega * i


@kernel
def mean_between(i_0: complex, i_1: complex, s_0: complex, s_1: complex, half: complex, T_s: float) -> complex:
    """Mean (A) over a period of the cubic through currents and slopes (A/s) at its ends."""
    back = half.conjugate()
    return 0.5 * (half * i_1 + back * i_0) + T_s / 12.0 * (back * s_0 - half * s_1)


def _sixth_power(x: Vector) -> Vector:
    x = x * x
    return x * x * x


def rows_of(runs: Sequence[Samples], machine: Machine, i_rated: float) -> Rows:
    """The rows of a recording's runs, one after the other, one control period each. Raises ValueError.

    The periods between one run's last sample and the next one's first are not `joined`. What no model changes is worked
    out at once.
    """
    if any(run.periods != 1 for run in runs):
        raise ValueError("expected a row for every control period, came rows of several")
    T = runs[0].T_s

    def column(name: str) -> Array | None:
        parts = [getattr(run, name) for run in runs]
        return None if any(part is None for part in parts) else np.concatenate(parts)

    theta, omega, i_d, i_q, u_d, u_q = (
        np.concatenate([getattr(run, name) for run in runs])
        for name in ("theta_e", "omega_e", "i_d", "i_q", "u_d", "u_q")
    )
    seams = np.cumsum([len(run) for run in runs])[:-1] - 1
    expected, heat = T * 0.5 * (omega[:-1] + omega[1:]), T * (i_d**2 + i_q**2)
    for seam, run in zip(seams, runs[1:], strict=True):
        if run.left_out is not None:
            heat[seam + 1] += run.left_out.heat
            expected[seam] = expected[seam] if run.left_out.turned is None else run.left_out.turned
    D = nearest_turns(np.diff(theta), expected)
    n = len(D)
    joined = np.ones(n, np.bool_)
    joined[seams] = False
    t: Any = np.concatenate([run.t0 + T * np.arange(len(run)) for run in runs])
    u_dc, i_a, i_b, i_c = column("u_dc"), column("i_a"), column("i_b"), column("i_c")
    u = (u_d + 1j * u_q)[:n]
    if u_dc is not None:  # duties are those of a link read at the start; it moves on within the period
        u = u * np.where(joined, 0.5 * (1.0 + u_dc[1:] / u_dc[:-1]), 1.0)
    zero = None if i_a is None or i_b is None or i_c is None else (i_a + i_b + i_c) / 3.0
    if zero is not None and np.std(zero) <= _NO_SENSOR * np.sqrt(np.mean(i_d**2 + i_q**2)):
        zero = None  # one phase is what the others leave: no third sensor bears witness
    i, edges = i_d + 1j * i_q, runs[0].edges
    rows = Rows(
        machine, T, i_rated, t, i, theta[0] + np.concatenate(([0.0], np.cumsum(D))),
        np.exp(0.5j * D), u, joined, None if u_dc is None else u_dc[:n], zero, np.cumsum(heat),
        (float(t[0]), float(t[-1] - t[0])), sampled=i * np.exp(1j * theta),
        hall_place=edges.place if edges else None, angle_error=edges.error if edges else 0.0,
    )  # fmt: skip
    rows.prepare()
    return rows.changed(left=rows.u - machine.R_s * rows.i_mean - rows.balance(rows.flux(rows.i)))
