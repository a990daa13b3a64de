"""The metrics of a running bench, as Prometheus reads them: text format 0.0.4, told against what REST says."""

import re
from pathlib import Path

import httpx
import pytest

from bench.api.models.metrics import MEDIA, metrics_text
from bench.config import Config, DriveConfig
from bench.live.window import Window
from bench.service.service import Service
from tests.conftest import JSON, RunningBench
from tests.support.served_drive import until

pytestmark = pytest.mark.live

DRIVE = "/api/drives/emulated"
SAMPLE = re.compile(r'([a-z_]+)(\{(?:[a-z_]+="(?:[^"\\\n]|\\[\\"n])*",?)*\})? (\S+)')


def read(text: str) -> dict[str, float]:
    """Samples by name and labels; what is not of the format fails."""
    assert text.endswith("\n")
    kinds, found = dict[str, str](), dict[str, float]()
    family = ""
    for line in text.splitlines():
        if line.startswith("# HELP "):
            family = line.split()[2]
            assert family not in kinds  # all of one family stand together
        elif line.startswith("# TYPE "):
            assert line.split()[2] == family
            kinds[family] = line.split()[3]
            assert (kinds[family] == "counter") == family.endswith("_total")
        else:
            match = SAMPLE.fullmatch(line)
            assert match is not None, line
            assert match[1] == family
            assert f"{match[1]}{match[2] or ''}" not in found
            found[f"{match[1]}{match[2] or ''}"] = float(match[3])
    return found


def test_prometheus_reads_what_rest_tells(running_bench: RunningBench) -> None:
    with httpx.Client(base_url=running_bench.url, headers=JSON) as client:
        until(lambda: client.get(f"{DRIVE}/estimates").json()["status"] == "ok", "estimates")
        before = client.get(DRIVE).json()["stream"]
        answer = client.get("/metrics")
        told, estimates = read(answer.text), client.get(f"{DRIVE}/estimates").json()["estimates"]
        latest = client.get(DRIVE).json()["latest"]
    assert answer.headers["content-type"] == MEDIA == "text/plain; version=0.0.4; charset=utf-8"
    of = '{drive="emulated"}'
    assert told[f"pmsm_bench_link_up{of}"] == told[f"pmsm_bench_operation_enabled{of}"] == 1
    assert told[f"pmsm_bench_stream_rows_total{of}"] >= before["rows"]
    assert told[f"pmsm_bench_stream_rows_per_second{of}"] == pytest.approx(1000.0, rel=0.2)
    for name in ("stream_gaps_total", "stream_rows_lost_total", "link_reconnects_total", "stream_clock_resets_total",
                 "fault_code"):  # fmt: skip
        assert told[f"pmsm_bench_{name}{of}"] == 0
    assert told[f"pmsm_bench_stream_age_seconds{of}"] < 2.0
    for parameter, what, unit, axis in (
        ("R_s", "resistance", "ohm", ""), ("L_d", "inductance", "henry", ',axis="d"'),
        ("L_q", "inductance", "henry", ',axis="q"'), ("psi_f", "magnet_flux_linkage", "weber", ""),
    ):
        labels = f'{{drive="emulated"{axis}}}'
        value, std = told[f"pmsm_bench_{what}_{unit}{labels}"], told[f"pmsm_bench_{what}_standard_error_{unit}{labels}"]
        assert value == pytest.approx(estimates[parameter]["value"], abs=10.0 * std)
        assert std == pytest.approx(estimates[parameter]["std"], rel=0.5)
        status = f'pmsm_bench_estimate_status{{drive="emulated",parameter="{parameter}",status='
        assert (told[f'{status}"ok"}}'], told[f'{status}"held"}}']) == (1, 0)
    for part in ("winding", "magnet"):
        known = f"pmsm_bench_{part}_temperature_celsius{of}"
        assert (known in told) == (latest[f"temp_{part}"] is not None)
    assert told['pmsm_bench_thread_alive{thread="estimation"}'] == 1
    assert told["pmsm_bench_uptime_seconds"] > 0.0
    assert told["pmsm_bench_recordings_free_bytes"] > 0.0
    assert told["pmsm_bench_recordings_under_way"] == told['pmsm_bench_diagnoses{state="running"}'] == 0


def test_what_is_under_way_is_counted(running_bench: RunningBench) -> None:
    with httpx.Client(base_url=running_bench.url, headers=JSON) as client:
        until(lambda: client.get(DRIVE).json()["link"]["state"] == "streaming", "the stream")
        address = client.post(f"{DRIVE}/recordings").headers["location"]
        assert read(client.get("/metrics").text)["pmsm_bench_recordings_under_way"] == 1
        client.delete(address).raise_for_status()
        assert read(client.get("/metrics").text)["pmsm_bench_recordings_under_way"] == 0


def test_of_a_drive_that_is_not_there_nothing_is_told_but_that(tmp_path: Path) -> None:
    """With a name that has to be escaped; the service is not entered."""
    drive = DriveConfig('spin"dle\\', "canopen://socketcand/127.0.0.1:1/can0/5", Window())
    told = read(metrics_text(Service(Config(drives=(drive,), captures=tmp_path, database="")), "0.1.0"))
    of = r'{drive="spin\"dle\\"'
    assert told[f"pmsm_bench_link_up{of}}}"] == 0
    assert told['pmsm_bench_info{version="0.1.0"}'] == 1
    assert told[f'pmsm_bench_estimate_status{of},parameter="R_s",status="no_data"}}'] == 1
    absent = ("resistance", "inductance", "age", "temperature", "operation_enabled", "fault_code")
    assert not [name for name in told if any(part in name for part in absent)]
