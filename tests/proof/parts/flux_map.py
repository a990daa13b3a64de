"""A plant on a measured flux map: saturation named, and psi_d(i_d, i_q), psi_q(i_d, i_q) recovered over its currents.

The emulated drive runs on the measured map; whoever diagnoses has R_s and one L_d, L_q and psi_f. What is compared with
is the measurement itself, at its own points, and not the emulator's spline through them.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from emulator.conceal.chance import Chance
from emulator.conceal.recording import recorded
from emulator.scenario.effects import NONE, MapFile
from emulator.scenario.motors import MOTORS
from emulator.scenario.scenarios import Excitation, Run, Scenario, drive_for
from estimator.diagnosis.diagnose import diagnose
from estimator.diagnosis.verdict import FluxTable
from estimator.machine import Machine
from estimator.physics.saturation import EFFECTS
from estimator.samples import Samples
from tests.proof.proof import Bar, Proof, Settings, Table
from tests.support.real_data import REAL_DATA

FILE: Final = REAL_DATA / "baldor_flux_map" / "baldor_400rpm_map.npz"
BAR: Final = 0.02  # of the rms flux linkage
_BALDOR: Final = MOTORS["baldor_ecs101m"]
_SECONDS: Final = 12.0
_QUICK: Final = 6.0  # s
_NEAR: Final = 1.0  # A: a measured point is visited where the recording comes so near
_FEWEST: Final = 20  # rows near it

Vectors = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class Miss:
    """How far a model's flux linkage is from the measured one."""

    rms: float  # over the rms flux linkage
    most: float  # largest, over the same
    at: complex  # A, where


def prove(settings: Settings) -> Proof:
    """Drive and diagnosis; the map that it tells, read as a table between whose points lines are drawn."""
    name, title = "flux_map", "A machine with a measured flux map"
    if not FILE.exists():
        missing = (
            f"{FILE.parent} is not there: expected the map of Aalto-Electric-Drives/motulator on GitHub (MIT), 5.6 kW "
            "magnet-assisted reluctance machine at 400 rpm, as an .npz file of complex arrays i_s_dq (A), psi_s_dq (Vs)"
        )
        return Proof(name, title, "", (), missing=missing)
    seconds = _QUICK if settings.quick else _SECONDS
    scenario, nominal = scenario_of(settings.seed, seconds), nominal_of(settings.seed)
    samples = samples_of(scenario, seconds)
    said = diagnose([samples], nominal)
    points, psi = visited(samples)
    by_constants, by_map, told = missed(psi, _constant(nominal, points), points), None, np.zeros(len(points), np.bool_)
    if said.flux_map is not None:
        found = at_points(said.flux_map, points)
        told = np.isfinite(found)
        by_map = missed(psi[told], found[told], points[told])
    named = sorted(finding.effect for finding in said.findings)
    right = named == sorted(EFFECTS) and said.verdict.value == "explained"
    i_d, i_q = (f"{x.min():.3g} to {x.max():.3g} A" for x in (samples.i_d, samples.i_q))
    bars = (
        Bar("saturation of both axes and cross-saturation are named, and nothing else", "all three",
            f"{', '.join(named) or 'none'}; {said.verdict}", right),
        Bar("rms error of the flux linkage by the map that is told", "at most 2 %",
            "no map" if by_map is None else f"{by_map.rms:.2%}", by_map is not None and by_map.rms <= BAR),
        Bar("its largest error", "at most 2 %",
            "no map" if by_map is None else f"{by_map.most:.2%} at {_told(by_map.at)}",
            by_map is not None and by_map.most <= BAR),
    )  # fmt: skip
    rows = [("constants that the nominal machine has", *_cells(by_constants))]
    if by_map is not None:
        rows.append(("map of the diagnosis", *_cells(by_map)))
    table = Table("Flux linkage recovered", ("model", "rms error", "largest error", "where"), tuple(rows))
    R_s = said.machine_after["R_s"]
    text = (
        f"{seconds:g} s at 300 to 800 rpm, i_d {i_d}, i_q {i_q}: {len(points)} of the measured points are visited, "
        f"of {np.count_nonzero(told)} of which the diagnosis tells the flux linkage. Errors are over its rms. "
        f"R_s comes out at {R_s.value:.4g} ohm, {scenario.motor.R_s:.4g} ohm is true. The diagnosis: {said.sentence}"
    )
    return Proof(name, title, text, bars, (table,))


def scenario_of(seed: int, seconds: float) -> Scenario:
    """The drive on the map, over a good part of its currents."""
    machine = _BALDOR.machine
    drive = drive_for(machine, _BALDOR.u_dc, T_s=1e-4, bridge="switched")
    excitation = Excitation(-4.0, 0.0, 10.0, 12.0, 0.02, kind="staircase", i_d_levels=11, level_time=0.2)
    run = Run(speed_rpm=300.0, rise_rpm=500.0, ramp_time=0.8 * seconds, seed=Chance(seed, 1, "run").seed())
    return Scenario("flux_map.toml", machine, drive, run, excitation, NONE._replace(flux_map=MapFile(str(FILE))))


def nominal_of(seed: int) -> Machine:
    """Constants: secants of the map from no current to half the rated one on each axis, each off by up to a tenth."""
    chance, rated = Chance(seed, 1, "nominal"), _BALDOR.machine
    i, psi = measured()
    half = 0.5 * rated.i_rated

    def at(point: complex) -> complex:
        return complex(psi[np.argmin(np.abs(i - point))])

    psi_f = at(0.0).real
    there_d, there_q = i[np.argmin(np.abs(i + half))], i[np.argmin(np.abs(i - 1j * half))]
    L_d = (at(there_d).real - psi_f) / there_d.real
    L_q = at(there_q).imag / there_q.imag
    off = [1.0 + chance.uniform(-0.08, 0.08) for _ in range(4)]
    return Machine(rated.R_s * off[0], L_d * off[1], L_q * off[2], psi_f * off[3], rated.n_p, rated.i_rated)


def measured(file: Path = FILE) -> tuple[Vectors, Vectors]:
    """Currents (A) and flux linkages (Vs) of all measured points."""
    with np.load(file) as content:
        return content["i_s_dq"].ravel(), content["psi_s_dq"].ravel()


def visited(samples: Samples) -> tuple[Vectors, Vectors]:
    """The measured points that the recording comes near."""
    i, psi = measured()
    went = samples.i_d + 1j * samples.i_q
    near = np.array([np.count_nonzero(np.abs(went - point) < _NEAR) >= _FEWEST for point in i])
    return i[near], psi[near]


def at_points(told: FluxTable, i: Vectors) -> Vectors:
    """Flux linkage (Vs) at currents (A), between a table's points by straight lines."""

    def place(x: NDArray[np.float64], of: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        n = np.clip(np.searchsorted(of, x) - 1, 0, len(of) - 2)
        return n, (x - of[n]) / (of[n + 1] - of[n])

    psi = told.psi_d + 1j * told.psi_q
    (a, x), (b, y) = place(i.real, told.i_d), place(i.imag, told.i_q)
    near, far = (psi[m, b] * (1.0 - y) + psi[m, b + 1] * y for m in (a, a + 1))
    return near * (1.0 - x) + far * x


def missed(psi: Vectors, told: Vectors, i: Vectors) -> Miss:
    """What a model's flux linkage misses of the measured one."""
    off, whole = np.abs(told - psi), float(np.sqrt(np.mean(np.abs(psi) ** 2)))
    worst = int(np.argmax(off))
    return Miss(float(np.sqrt(np.mean(off**2))) / whole, float(off[worst]) / whole, complex(i[worst]))


def _constant(machine: Machine, i: Vectors) -> Vectors:
    return machine.L_d * i.real + machine.psi_f + 1j * machine.L_q * i.imag


def samples_of(scenario: Scenario, seconds: float) -> Samples:
    r = recorded(scenario, round(seconds / scenario.drive.T_s))
    columns = (r[name] for name in ("theta_e", "omega_e", "i_d", "i_q", "u_d", "u_q"))
    theta_e, omega_e, i_d, i_q, u_d, u_q = columns
    return Samples(theta_e, omega_e, i_d, i_q, u_d, u_q, scenario.drive.T_s, u_dc=r["u_dc"])


def _cells(miss: Miss) -> tuple[str, str, str]:
    return f"{miss.rms:.2%}", f"{miss.most:.2%}", _told(miss.at)


def _told(i: complex) -> str:
    return f"i_d = {i.real:g} A, i_q = {i.imag:g} A"
