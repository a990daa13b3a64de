"""The shaft over REST: a drive that swings its speed tells its inertia, one on a dynamometer says that it cannot."""

from pathlib import Path
from typing import Any

import httpx
import pytest

from emulator.scenario.text import text_of
from tests.conftest import JSON, RunningBench, bench_up
from tests.estimator.mechanics import shafts
from tests.support.served_drive import until

pytestmark = pytest.mark.live

ESTIMATES = "/api/drives/emulated/estimates"
UNITS = {"J": "kg m2", "B": "Nm s/rad", "T_C": "Nm", "tau_L": "Nm"}


def test_a_shaft_on_a_dynamometer_is_said_not_to_accelerate(running_bench: RunningBench) -> None:
    with httpx.Client(base_url=running_bench.url) as client:
        until(lambda: client.get(ESTIMATES).json()["mechanics"]["status"] != "no_data", "the shaft to be looked at")
        told = client.get(ESTIMATES).json()["mechanics"]
    assert told["status"] == "no_acceleration"
    assert "does not accelerate" in told["sentence"]
    assert {name: e["unit"] for name, e in told["estimates"].items()} == UNITS
    for e in told["estimates"].values():
        assert (e["value"], e["std"], e["status"]) == (None, None, "not_told")


def test_a_shaft_that_swings_is_told_with_units_and_intervals_and_stays_when_the_drive_stops(tmp_path: Path) -> None:
    swings = shafts.shaft(counts=65536)
    scenario = tmp_path / "swings.toml"
    scenario.write_text(text_of(swings), encoding="utf-8")
    with bench_up("--scenario", str(scenario)) as bench, httpx.Client(base_url=bench.url, headers=JSON) as client:
        def now() -> dict[str, Any]:
            return client.get(ESTIMATES).json()["mechanics"]

        until(lambda: now()["status"] == "ok" and now()["sum"] is None, "the shaft to be told, both ways")
        told = now()
        assert (told["since"], told["sentence"], told["sum"], told["direction"]) == (None, "", None, 0)
        truth = shafts.truth_of(swings)
        for name, e in told["estimates"].items():
            assert (e["status"], e["unit"]) == ("ok", UNITS[name])
            assert e["value"] == pytest.approx(truth[name], abs=5.0 * e["std"]), name
        assert told["stretches"] > 40
        assert told["residual_rms_Nm"] < 0.1 * told["torque_rms_Nm"]
        client.post("/api/drives/emulated/stop").raise_for_status()
        until(lambda: now()["status"] == "stale", "the shaft to be stale")
        stale = now()
        assert stale["since"] is not None
        assert "bridge" in stale["sentence"] or "drive" in stale["sentence"]
        assert stale["estimates"]["J"]["value"] == pytest.approx(truth["J"], rel=0.05)
        assert {e["status"] for e in stale["estimates"].values()} == {"stale"}
