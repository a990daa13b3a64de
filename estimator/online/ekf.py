"""Extended Kalman filter for R_s, L_d, L_q: with the published states and tuning, and with a better-posed model.

    x = f(x, u)      P = F P F' + Q T                                     prediction, F = df/dx
    S = H P H' + R   K = P H' S^-1   x += K (i - H x)                     correction by the current at the row's end
    P = (I - K H) P (I - K H)' + K R K'                                   Joseph's form: symmetric, never negative

`Model.FLUXES` is the published one: states i_d, i_q, psi_d, psi_q, R_s, Euler steps of one row, and no word that the
flux linkage belongs to the current:

    di_d/dt = (u_d - R_s i_d + omega psi_q)/L_d      di_q/dt = (u_q - R_s i_q - omega psi_d)/L_q      zero for the rest
    L_d = (psi_d - psi_f)/i_d                        L_q = psi_q/i_q

The L_d, L_q in its equations are those it started from. The publication leaves that open; the running ratio, the other
reading, has a pole at every zero of a current, and a filter that feeds it back into its own model can run away. The
start values do not shift a steady estimate: they divide both sides. Its Q is read as a rate per second, which makes
it independent of the row time. From: S. Wang, Windowed Least Square Algorithm Based PMSM Parameters Estimation,
Mathematical Problems in Engineering, 2013, doi 10.1155/2013/131268.

`Model.INDUCTANCES` has the states i_d, i_q, R_s, L_d, L_q and the flux balance of whole rows, with the mean current of
the row as an input; see `flux_balance`, whose small terms with h and (R_s T_s)^2/(12 L) are in the code:

    i_d += T/(L_d c) (u_d - R_s i_d_mean + L_q y_q)                           c = cos(D/2)
    i_q += T/(L_q c) (u_q - R_s i_q_mean - L_d y_d - psi_f s)

A Kalman filter takes its Jacobian for exact; one that is made of noise would "tell" parameters from nothing. So this
model learns from currents, and from changes of current, only where they stand out of the noise that R states.

psi_f is held in both: the published filter reads L_d off psi_d - psi_f.

A filter's P knows its tuning, not the data: where little is excited, or the tuning does not suit the drive, it is
small around a wrong value. So recursive least squares over the recent rows runs beside it (`rls`), and `estimate` tells
only what that tells too, no closer than it and no closer than the two agree. Knows nothing of clocks, drives or files.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Final

import numpy as np

from estimator.arrays import Array
from estimator.interval import Z_95
from estimator.machine import PARAMETERS, UNITS
from estimator.online import rls
from estimator.online.estimate import Estimate, Status, WindowEstimate
from estimator.online.flux_balance import angle_turned, flux_balance
from estimator.online.kalman import filtered
from estimator.online.rls import RlsState
from estimator.online.solve import at_held
from estimator.online.stream import Stream, runs_of
from estimator.samples import Samples

Five = tuple[float, float, float, float, float]

TELLABLE: Final = ("R_s", "L_d", "L_q")
RECENT: Final = 0.999  # forgetting factor of the least squares beside the filter: a thousand rows
_AT_START: Final = 0.6  # share of P_0 from which a variance counts as not reduced


class FilterModel(IntEnum):
    """What the filter takes the machine for."""

    FLUXES = 0  # the published states
    INDUCTANCES = 1


@dataclass(frozen=True, slots=True)
class EkfTuning:
    """Variances of a filter, in the order of its model's states.

    FLUXES: i_d, i_q, psi_d, psi_q, R_s. INDUCTANCES: i_d, i_q, R_s, L_d, L_q.
    """

    P_0: Five  # A^2, A^2, then Vs^2, Vs^2, ohm^2 or ohm^2, H^2, H^2: at the start
    Q: Five  # the same per second: what a state may move on its own
    R: tuple[float, float]  # A^2, A^2: of a sampled i_d, i_q
    i_min: float = 0.5  # A, FLUXES: a smaller current tells no inductance
    model: FilterModel = FilterModel.FLUXES


PAPER: Final = EkfTuning(P_0=(0.1, 0.1, 0.0004, 0.002, 0.02), Q=(30.0, 15.0, 0.005, 0.03, 0.03), R=(0.1, 0.02))
"""The published tuning."""


def tuned(
    R_s: float, L_d: float, L_q: float, *, noise_i: float, lsb: float, omega_e: float, T_s: float,
    doubt: float = 0.3, warming: float = 1.0,
) -> EkfTuning:
    """Tuning of the better-posed model from what a data sheet says of motor (ohm, H) and drive.

    `noise_i` (A) and `lsb` (A) are noise and resolution of a phase current's sensor: R = 2/3 (noise^2 + lsb^2/12), the
    2/3 from three phases to two axes. The same noise enters by the mean current: per second, with `omega_e` (rad/s),
    (omega_e L_q/L_d)^2 R T_s on the d axis. `doubt` is the relative deviation of the start values. `warming` (K/s)
    moves the parameters as in the published table: 0.38, 0.05 and 0.08 % per kelvin.
    """
    R = (noise_i**2 + lsb**2 / 12.0) * 2.0 / 3.0
    input_d, input_q = ((omega_e * ratio) ** 2 * R * T_s for ratio in (L_q / L_d, L_d / L_q))
    moves = [(share * value * warming) ** 2 for share, value in ((3.8e-3, R_s), (0.5e-3, L_d), (0.8e-3, L_q))]
    start = [(doubt * value) ** 2 for value in (R_s, L_d, L_q)]
    return EkfTuning(
        P_0=(R, R, start[0], start[1], start[2]), Q=(input_d, input_q, moves[0], moves[1], moves[2]), R=(R, R),
        model=FilterModel.INDUCTANCES,
    )


TUNED: Final = tuned(0.9664, 4.24e-3, 6.21e-3, noise_i=10e-3, lsb=36.0 / 4096, omega_e=503.0, T_s=1e-4)
"""For the published motor at 1200 rpm on a drive with 10 mA of noise and 12 bits over +-18 A."""


@dataclass(slots=True, eq=False)
class EkfState:
    """The filter; `update` changes it in place and returns it."""

    estimated: tuple[str, ...]
    known: Mapping[str, float]  # SI: start values and held ones
    tuning: EkfTuning
    P_0: Array  # (5, 5), zero for a held parameter
    Q: Array  # (5,), per second, zero for a held parameter
    x: Array  # (5,), states in the order of the model
    P: Array  # (5, 5), their covariance
    level: Array  # (2,), A: i_d and i_q as they last stood out of their noise
    sums: Array  # (2,): squared innovations as a voltage over the row in V^2, restarts
    recent: RlsState  # least squares over the recent rows
    stream: Stream = field(default_factory=Stream)
    samples: int = 0  # rows taken in

    @property
    def restarts(self) -> int:
        """Times that the filter ran away and started anew."""
        return int(self.sums[1])


def init(
    beta_0: Mapping[str, float], held: Mapping[str, float], estimated: Sequence[str] = TELLABLE,
    tuning: EkfTuning = PAPER,
) -> EkfState:
    """A filter that starts from `beta_0` (SI); `held` has psi_f and what else is not estimated. Raises ValueError."""
    for name in estimated:
        if name not in TELLABLE:
            raise ValueError(f"the filter estimates {', '.join(TELLABLE)} and holds the rest, got {name}")
    for name in PARAMETERS:
        source, role = (beta_0, "a start value") if name in estimated else (held, "a held value")
        if not 0.0 < source.get(name, 0.0) < math.inf:
            raise ValueError(f"{name} needs {role} that is positive, got {source.get(name, 'none')}")
    known = {**beta_0, **held, **{name: beta_0[name] for name in estimated}}
    places = {"R_s": 4} if tuning.model is FilterModel.FLUXES else {"R_s": 2, "L_d": 3, "L_q": 4}
    free = np.ones(5)
    free[[place for name, place in places.items() if name not in estimated]] = 0.0
    x = np.zeros(5)
    for name, place in places.items():
        x[place] = known[name]
    P_0 = np.diag(free * tuning.P_0)
    recent = rls.init(estimated, known, RECENT)
    return EkfState(
        tuple(estimated), known, tuning, P_0, free * tuning.Q, x, P_0.copy(), np.zeros(2), np.zeros(2), recent
    )


def warm_up() -> None:
    """Compile the kernels, or load them from the cache."""
    still = np.zeros(3)
    one = dict.fromkeys(PARAMETERS, 1.0)
    estimate(update(init(one, one), Samples(still, still, still, still, still, still, T_s=1.0)))


def update(state: EkfState, samples: Samples, *, joined: bool = True) -> EkfState:
    """Take in consecutive samples, one or many; `joined` and values that are not finite as in `stream.runs_of`.

    After a gap currents and flux linkages start from the sample; parameters and their covariance stay.
    """
    rls.update(state.recent, samples, joined=joined)
    start = np.array([state.known[name] for name in PARAMETERS])
    R, model = np.array(state.tuning.R), int(state.tuning.model)
    for run, continues in runs_of(state.stream, samples, joined=joined):
        if not continues:
            _restart_currents(state, float(run.i_d[0]), float(run.i_q[0]))
        balance = flux_balance(run)
        state.samples += len(balance)
        rows = np.column_stack((balance, angle_turned(balance, run.T_s), run.i_d[1:], run.i_q[1:]))
        filtered(
            rows, run.T_s, run.periods, model, start, state.P_0, state.Q, R, state.x, state.P, state.level, state.sums
        )
    return state


def estimate(state: EkfState) -> WindowEstimate:
    """What the filter says now, as far as the recent rows bear it out; see above."""
    least_squares = rls.estimate(state.recent)
    recent = least_squares.estimates
    estimates: dict[str, Estimate] = {}
    for name in PARAMETERS:
        if name not in state.estimated:
            estimates[name] = at_held(name, state.known)
        elif state.samples == 0:
            estimates[name] = Estimate(name, None, None, UNITS[name], Status.NO_DATA, "no row has come in yet")
        else:
            estimates[name] = _told_by_filter(name, *_parameter_told(state, name), state.known[name], recent[name])
    n = state.samples
    rms = math.sqrt(state.sums[0] / (2 * n)) if n else None
    return WindowEstimate(
        estimates, n, state.stream.gaps, 2 * n, n > 0, None, rms, state.stream.left_out,
        impossible=least_squares.impossible,
    )


def _told_by_filter(name: str, value: float, variance: float, reason: str, known: float, recent: Estimate) -> Estimate:
    """The filter's value, unless it has a reason not to tell it or the recent rows have one."""
    if not reason and (recent.value is None or recent.std is None):
        reason = recent.reason
    if not reason and recent.value is not None:
        std = max(math.hypot(math.sqrt(variance), value - recent.value), recent.std or 0.0)
        if Z_95 * std < value:
            return Estimate(name, value, std, UNITS[name], Status.OK)
        reason = (
            f"{name} cannot be told here: the filter says {value:.3g} {UNITS[name]}, least squares {recent.value:.3g}"
        )
    return Estimate(name, known, None, UNITS[name], Status.NOT_TOLD, reason)


def values(state: EkfState) -> dict[str, float]:
    """What the filter itself has for each parameter, borne out or not; NaN where it has nothing."""
    found = {name: _parameter_told(state, name) for name in state.estimated}
    return dict(state.known) | {name: math.nan if reason else value for name, (value, _, reason) in found.items()}


def _parameter_told(state: EkfState, name: str) -> tuple[float, float, str]:
    """Value, variance, and why the filter cannot tell it (empty where it can)."""
    x, P = state.x, state.P
    if state.tuning.model is FilterModel.INDUCTANCES or name == "R_s":
        place = TELLABLE.index(name) + 2 if state.tuning.model is FilterModel.INDUCTANCES else 4
        value, variance = float(x[place]), float(P[place, place])
        unmoved = variance >= _AT_START * state.P_0[place, place]
        return value, variance, f"the rows have told nothing of {name} beyond its start value" if unmoved else ""
    axis = 0 if name == "L_d" else 1
    i, letter = float(x[axis]), "i_d" if name == "L_d" else "i_q"
    least = max(state.tuning.i_min, 3.0 * math.sqrt(P[axis, axis]))
    if abs(i) < least:
        return 0.0, 0.0, f"{name} is a flux linkage over {letter}, and that is {i:.3g} A now, less than {least:.3g} A"
    psi = float(x[2 + axis]) - (state.known["psi_f"] if name == "L_d" else 0.0)
    L = psi / i
    slope = np.zeros(5)  # dL/dx
    slope[axis], slope[2 + axis] = -L / i, 1.0 / i
    return L, max(0.0, float(slope @ P @ slope)), ""


def _restart_currents(state: EkfState, i_d: float, i_q: float) -> None:
    """Currents, and flux linkages where they are states, from a sample; what is known of parameters stays."""
    fluxes = state.tuning.model is FilterModel.FLUXES
    x, P = state.x, state.P
    x[:2] = i_d, i_q
    if fluxes:
        x[2:4] = state.known["L_d"] * i_d + state.known["psi_f"], state.known["L_q"] * i_q
    n = 4 if fluxes else 2
    P[:n, :] = P[:, :n] = 0.0
    P[:n, :n] = state.P_0[:n, :n]
