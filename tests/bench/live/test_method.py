"""The estimator that runs: a change of method or settings begins anew only what it must, and nothing on failure."""

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.live import method
from bench.live.method import SPEED_ROWS, Running
from bench.live.window import Window
from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.scenarios import PAPER
from estimator.machine import PARAMETERS
from estimator.online.estimate import Status
from estimator.samples import Samples
from tests.support.samples import streamed

HELD = {"R_s": 0.9, "L_d": 4.4e-3, "L_q": 6.0e-3, "psi_f": 0.12}
WLS = Window(length=500, held=HELD)
RLS = WLS.changed({"method": "rls", "forgetting_factor": 0.999})
EKF = WLS.changed({"method": "ekf"})


@cache
def stream() -> Samples:
    """Nine tenths of a second of the emulated drive."""
    return streamed(VirtualDrive(PAPER), 900)


def fed(window: Window, samples: Samples, cuts: Sequence[int] = ()) -> Running:
    """An estimator after these samples, handed over in pieces."""
    running = method.start(window)
    for start, end in zip([0, *cuts], [*cuts, len(samples)], strict=True):
        method.take(running, samples[start:end], joined=True)
    return running


def values(running: Running) -> list[float | None]:
    return [estimate.value for estimate in method.estimate(running).estimates.values()]


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(cuts=st.lists(st.integers(1, 899), max_size=6, unique=True).map(sorted), window=st.sampled_from([WLS, RLS, EKF]))
def test_every_method_says_the_same_however_the_stream_is_cut(cuts: list[int], window: Window) -> None:
    assert values(fed(window, stream(), cuts)) == pytest.approx(values(fed(window, stream())), rel=1e-9)


@pytest.mark.parametrize("window", [RLS, EKF])
def test_another_method_begins_with_the_next_sample_while_the_window_keeps_all(window: Window) -> None:
    running = method.changed(fed(WLS, stream()[:400]), window)
    result = method.estimate(running)
    assert result.samples == 0
    assert {e.status for e in result.estimates.values()} <= {Status.NO_DATA, Status.HELD}
    method.take(running, stream()[400:], joined=True)
    assert method.estimate(running).samples == 499  # the first row waits for its end
    back = method.changed(running, WLS.changed({"length": 800}))
    assert (method.estimate(back).samples, method.estimate(back).gaps) == (800, 0)


@pytest.mark.parametrize(
    ("window", "change", "goes_on"),
    [
        (RLS, {"forgetting_factor": 0.99}, True),
        (RLS, {"estimated": ["R_s", "L_q"]}, True),
        (RLS, {"held": {"R_s": 1.0}}, True),
        (RLS, {"length": "auto", "ekf": {"preset": "paper"}}, True),
        (RLS, {"periods_per_row": 2}, False),
        (EKF, {"length": 700, "periods_per_row": 3, "forgetting_factor": 0.99}, True),
        (EKF, {"ekf": {"noise_i": 0.02}}, False),
        (EKF, {"held": {"R_s": 1.0}}, False),
        (EKF, {"estimated": ["R_s", "L_q"]}, False),
    ],
)
def test_a_change_begins_anew_only_what_cannot_go_on(
    window: Window, change: dict[str, object], goes_on: bool
) -> None:
    running = method.changed(fed(window, stream()), window.changed(change))
    assert method.estimate(running).samples == (899 if goes_on else 0)


def test_a_recursion_uses_at_once_what_is_held_now() -> None:
    running = fed(RLS, stream())
    held = method.changed(running, RLS.changed({"estimated": ["R_s", "L_d", "L_q"], "held": {"psi_f": 0.11}}))
    estimates = method.estimate(held).estimates
    assert (estimates["psi_f"].status, estimates["psi_f"].value) == (Status.HELD, 0.11)
    assert method.estimate(running).estimates["psi_f"].status is Status.OK  # the one before is as it was


@pytest.mark.parametrize("window", [WLS, RLS, EKF])
def test_what_was_changed_stays_as_it_was_until_it_is_left(window: Window) -> None:
    running = fed(window, stream())
    before = method.estimate(running)
    for change in ({"length": 100}, {"periods_per_row": 7}, {"method": "rls", "forgetting_factor": 0.99},
                   {"estimated": ["R_s"]}, {"length": "auto"}):
        method.changed(running, window.changed(change))
        assert method.estimate(running) == before


def test_the_filter_waits_for_rows_to_learn_the_speed_from_unless_it_is_told() -> None:
    running = fed(EKF, stream()[: SPEED_ROWS - 1])
    told = method.estimate(running).estimates["R_s"]
    assert told.status is Status.NO_DATA
    assert told.reason == "the Kalman filter waits for 100 rows, to learn the speed from them"
    method.take(running, stream()[SPEED_ROWS - 1 : SPEED_ROWS], joined=True)
    assert method.estimate(running).samples == SPEED_ROWS - 1
    known = EKF.changed({"ekf": {"omega_e": float(np.abs(stream().omega_e[:SPEED_ROWS]).max())}})
    assert method.estimate(fed(known, stream()[:10])).samples == 9
    assert values(fed(known, stream())) == pytest.approx(values(fed(EKF, stream())), rel=1e-12)


def test_rows_without_a_value_do_not_spoil_what_the_filter_learns() -> None:
    holed = replace(stream(), omega_e=stream().omega_e.copy())
    holed.omega_e[3] = np.nan
    result = method.estimate(fed(EKF, holed))
    assert (result.samples, result.gaps) == (897, 1)
    assert result.estimates["R_s"].value == pytest.approx(0.9664, rel=0.02)


def test_rows_without_any_speed_are_a_break_before_the_filter_starts_and_are_not_kept() -> None:
    running = fed(EKF, stream()[:50])
    silent = replace(stream()[50:60], omega_e=np.full(10, np.nan))
    method.take(running, silent, joined=True)
    assert running.filter is not None
    assert running.filter.waiting == []
    method.take(running, stream()[60:], joined=True)
    result = method.estimate(running)
    assert (result.samples, result.gaps) == (839, 0)
    assert result.estimates["R_s"].value == pytest.approx(0.9664, rel=0.02)


def test_the_filter_holds_the_flux_linkage_and_says_so_where_it_was_to_be_estimated() -> None:
    asked = method.estimate(fed(EKF, stream())).estimates
    assert [asked[name].status for name in PARAMETERS] == [Status.OK, Status.OK, Status.OK, Status.HELD]
    assert asked["psi_f"].reason == "the Kalman filter holds it at the given value"
    held = method.estimate(fed(EKF.changed({"estimated": ["R_s"]}), stream())).estimates
    assert [held[name].status for name in PARAMETERS] == [Status.OK, Status.HELD, Status.HELD, Status.HELD]
    assert held["psi_f"].reason == "held at the given value"


LIMITS = {
    "noise_i": (1e-6, 1e4), "lsb": (0.0, 1e4), "omega_e": (0.0, 1e5), "doubt": (0.01, 1.0), "warming": (0.0, 1e3),
}


@settings(max_examples=30, deadline=None)
@given(st.fixed_dictionaries({key: st.floats(low, high) for key, (low, high) in LIMITS.items()}))
def test_no_tuning_within_its_limits_breaks_the_filter(tuning: dict[str, float]) -> None:
    result = method.estimate(fed(EKF.changed({"ekf": tuning}), stream()[:300]))
    for estimate in result.estimates.values():
        assert estimate.value is not None
        assert np.isfinite(estimate.value)


COMPILED_LATER = """
import sys
import numpy as np
from numba.core.dispatcher import Dispatcher
from bench.live import method
from bench.live.window import Window
from estimator.samples import Samples

def compiled():
    return {
        (module.__name__, name): len(value.overloads)
        for module in list(sys.modules.values()) if module.__name__.startswith("estimator.")
        for name, value in vars(module).items() if isinstance(value, Dispatcher)
    }

method.warm_up()
before = compiled()
random = np.random.default_rng(1)
held = {"R_s": 0.9, "L_d": 4.4e-3, "L_q": 6.0e-3, "psi_f": 0.12}
samples = Samples(*random.standard_normal((6, 1000)), T_s=1e-4)
plain = Window(length=500, held=held)
for change in {}, {"length": "auto"}, {"method": "rls"}, {"method": "ekf"}, {"periods_per_row": 4}, {"length": 100}:
    running = method.start(plain)
    method.take(running, samples, joined=True)
    running = method.changed(running, plain.changed(change))
    method.take(running, samples, joined=True)
    method.take(running, samples[:7], joined=False)
    method.estimate(running)
after = compiled()
print(len(before), [name for name in after if after[name] != before[name]])
"""


def test_nothing_is_left_to_compile_while_it_runs() -> None:
    """A compilation stops every thread for a second, and the samples with it."""
    ran = subprocess.run([sys.executable, "-c", COMPILED_LATER], capture_output=True, text=True, check=True)
    kernels, later = ran.stdout.split(maxsplit=1)
    assert int(kernels) > 5
    assert later.strip() == "[]"
