"""A drive's compensation of its dead time: its closed form, and what it leaves of emulated drives that have it."""

import cmath
import math
from dataclasses import replace

import numpy as np
import pytest

from emulator.drive.virtual_drive import VirtualDrive
from emulator.plant.physics.compensation import Compensation
from emulator.plant.physics.legs import Inverter
from estimator.arrays import Array, Vector
from estimator.diagnosis.likelihood.thinning import settled
from estimator.machine import PARAMETERS, Machine
from estimator.physics.dead_time_compensation import BY_COMMAND, BY_OWN, BY_SAMPLE, BY_TURNED, EFFECT
from estimator.physics.rows import Rows, rows_of
from estimator.samples import Samples
from estimator.twin.model import Model
from tests.estimator.physics.equations import left_of, with_effect
from tests.support.samples import machine_of, rows_of_columns

MACHINE = Machine(R_s=1.0, L_d=4e-3, L_q=6e-3, psi_f=0.1, n_p=4, i_rated=6.0)
T_S, U_DC, N = 1e-4, 300.0, 400
OMEGA = 200.0  # rad/s, electrical


def turning(i: Vector) -> Rows:
    """Rows of given currents (A, rotor frame), at one speed."""
    n = len(i)
    theta: Array = np.linspace(0.0, OMEGA * T_S * (n - 1), n)
    return rows_of(
        [Samples(theta, np.full(n, OMEGA), i.real, i.imag, np.zeros(n), np.full(n, 20.0), T_S, u_dc=np.full(n, U_DC))],
        MACHINE, 6.0,
    )  # fmt: skip


def share(i_s: complex, width: float) -> complex:
    """Space vector of the phases' currents over a width, within -1 and 1."""
    found = 0j
    for leg in range(3):
        axis = cmath.exp(2j * math.pi / 3.0 * leg)
        found += 2.0 / 3.0 * min(max((i_s * axis.conjugate()).real / width, -1.0), 1.0) * axis
    return found


@pytest.mark.parametrize("by", [BY_TURNED, BY_SAMPLE, BY_OWN, BY_COMMAND])
@pytest.mark.parametrize("width", [1e-3, 1.0])
def test_what_is_recorded_lacks_what_the_legs_are_given(by: int, width: float) -> None:
    rows, i = turning(np.full(N, -1.0 + 3.0j)), -1.0 + 3.0j
    step = OMEGA * T_S
    found = EFFECT.voltage(rows, (1e-6, width, float(by)))
    for k in range(20, N - 20):
        turned = {BY_TURNED: 0.5, BY_SAMPLE: -1.0, BY_OWN: 0.5, BY_COMMAND: 0.5}[by]
        i_s = i * cmath.exp(1j * step * (k + turned))
        expected = -1e-6 / T_S * U_DC * share(i_s, width) * cmath.exp(-1j * step * (k + 0.5))
        assert complex(found[k]) == pytest.approx(expected, abs=1e-9)


def test_it_goes_by_the_currents_as_they_were_sampled() -> None:
    noise = np.random.default_rng(1).normal(0.0, 0.3, (2, N))
    rows = turning(0.5j + noise[0] + 1j * noise[1])
    clean = rows.with_currents(np.full(N, 0.5j))
    sizes = 1e-6, 1e-3, float(BY_TURNED)
    assert np.array_equal(EFFECT.voltage(clean, sizes), EFFECT.voltage(rows, sizes))
    assert np.std(EFFECT.voltage(rows, sizes)) > 0.5


@pytest.mark.slow
@pytest.mark.parametrize("by", [BY_TURNED, BY_SAMPLE])
@pytest.mark.parametrize("part", [0.5, 1.8])
@pytest.mark.parametrize("motor", ["servo_4nm", "mini_cheetah", "lea_52k"])
def test_dead_time_and_compensation_leave_what_noise_leaves(motor: str, part: float, by: int) -> None:
    plain = with_effect("none", motor)
    T, i_rated = plain.drive.T_s, plain.motor.i_rated
    drive = replace(plain.drive, noise_i=1e-3 * i_rated, encoder_counts=0, timer_counts=0)
    lost, added = Inverter(dead_time=0.01 * T), Compensation(part * 0.01 * T, by=by)
    effects = plain.effects._replace(inverter=lost, compensation=added, timing=plain.effects.timing._replace(lost=0.0))

    def left(effects_there: dict[str, tuple[float, ...]], *, there: bool) -> float:
        scenario = replace(plain, drive=drive, effects=effects if there else plain.effects)
        c = VirtualDrive(scenario).record(round(1.0 / T))
        rows = settled(rows_of_columns(c, machine_of(plain.motor), T))
        return left_of(rows, Model(rows.machine, effects_there))

    inverter = 0.01 * T, 0.0, 1e-3 * i_rated, 0.01 * i_rated
    both = {"inverter_voltage_error": inverter, EFFECT.name: (part * 0.01 * T, 1e-4 * i_rated, float(by))}
    before, after, noise = left({}, there=True), left(both, there=True), left({}, there=False)
    print(f"{motor}, {part} times: {before:.3g} per mille of rated current, {after:.3g}, noise {noise:.3g}")
    assert after**2 - noise**2 < 1e-3 * before**2


def test_sizes_are_what_the_library_says() -> None:
    assert [parameter.name for parameter in EFFECT.parameters] == ["time", "width", "by"]
    assert not set(PARAMETERS) & {parameter.name for parameter in EFFECT.parameters}
