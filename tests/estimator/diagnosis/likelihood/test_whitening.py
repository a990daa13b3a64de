"""Whitening: noise of the currents comes out white, after gaps too, and voltages come back."""

import math
from dataclasses import replace

import numpy as np
import pytest

from estimator.diagnosis.likelihood.averages import voltage_of
from estimator.diagnosis.likelihood.noise import filter_of, whitened
from estimator.machine import Machine
from estimator.physics.ac_resistance import voltage
from estimator.physics.rows import Rows, rows_of
from estimator.samples import Samples
from tests.estimator.diagnosis.convention_runs import recording

MACHINE = Machine(R_s=0.5, L_d=5e-3, L_q=5e-3, psi_f=0.1, n_p=4, i_rated=10.0)
SALIENT = replace(MACHINE, R_s=0.06, L_q=40e-3)
T_S, SIGMA, RUN, RUNS = 1e-4, 1e-5, 200, 200  # s, Vs, periods, count


@pytest.fixture(scope="module", params=[MACHINE, SALIENT], ids=["round", "salient"])
def gappy(request: pytest.FixtureRequest) -> Rows:
    """A turning rotor, with a row lost after every run."""
    runs: list[Samples] = []
    for k in range(RUNS):
        t = T_S * ((RUN + 1) * k + np.arange(RUN))
        none, speed = np.zeros(RUN), np.full(RUN, 500.0)
        runs.append(Samples(np.mod(500.0 * t, math.tau), speed, none + 1.0, none, none, none, T_S, t0=float(t[0])))
    return rows_of(runs, request.param, 10.0)


def test_noise_is_white_from_a_gap_on_and_its_voltage_comes_back(gappy: Rows) -> None:
    rng, n, ratio = np.random.default_rng(1), len(gappy), gappy.machine.L_q / gappy.machine.L_d
    rho_d, rho_q = (math.exp(-gappy.machine.R_s * T_S / L) for L in (gappy.machine.L_d, gappy.machine.L_q))
    d, q = SIGMA * rng.normal(size=n + 1), SIGMA * ratio * rng.normal(size=n + 1)
    flux, kept = d + 1j * q, rho_d * d + 1j * rho_q * q
    v = (gappy.half * flux[1:] - gappy.half.conj() * kept[:-1]) / T_S * gappy.joined
    z = whitened(v, filter_of(gappy, gappy.machine))
    since = np.arange(n) % RUN  # 0 right after the begin of a run
    axes = np.array([z.real, z.imag / ratio]) / SIGMA
    turned = (ratio * math.sin(gappy.D[0])) ** 2  # into d, of what is not known yet of q
    for first, last, most in ((0, 1, 2.3), (1, 5, 1.5), (5, 20, 1.2), (20, RUN - 1, 1.05)):
        then = np.mean(axes[:, gappy.joined & (since >= first) & (since < last)] ** 2, axis=1)
        assert 0.9 < then[0] < most + (last <= 20) * turned
        assert 0.9 < then[1] < most
    both = gappy.joined[1:] & gappy.joined[:-1]
    assert np.all(np.abs(axes[:, 1:] * both @ axes[:, :-1].T) < 0.02 * n)
    assert np.allclose(voltage_of(gappy, z), v, atol=1e-9 * SIGMA / T_S)


def test_a_rung_of_the_ladder_remembers_over_a_lost_row() -> None:
    (run, *_), nominal = recording("none", 1, length=1.0)
    rated = nominal.i_rated or 1.0
    whole, gapped = (rows_of(runs, nominal, rated) for runs in ([run], [run[:5000], run[5001:]]))
    v, w = (voltage(rows, (0.9, 150.0)) for rows in (whole, gapped))
    off = np.abs(w[5000:5030] - v[5001:5031])
    assert np.max(off) < 0.02 * float(np.sqrt(np.mean(np.abs(v) ** 2)))
