"""What a monitoring system reads of the service: Prometheus' text format 0.0.4, base units in the names.

What is not known now has no sample: after a lost link, or where an estimate is stale or held, a series ends rather than
going on with old values. Sources: prometheus.io/docs, "Exposition formats" and "Metric and label naming".
"""

import math
from collections.abc import Iterator
from typing import Final

from bench.live.acquisition import LinkState
from bench.service.service import Service
from drivers.wire.cia402 import State
from estimator.online.estimate import Status

MEDIA: Final = "text/plain; version=0.0.4; charset=utf-8"
_PREFIX: Final = "pmsm_bench_"
_ESTIMATED: Final = (Status.OK, Status.DOUBTFUL)
_PARAMETERS: Final[dict[str, tuple[str, str, dict[str, str]]]] = {  # what each is called, its unit, its labels
    "R_s": ("resistance", "ohm", {}), "L_d": ("inductance", "henry", {"axis": "d"}),
    "L_q": ("inductance", "henry", {"axis": "q"}), "psi_f": ("magnet_flux_linkage", "weber", {}),
}  # fmt: skip
_FAMILIES: Final = {
    "info": ("gauge", "The service's version, always 1."),
    "uptime_seconds": ("gauge", "Since the service started."),
    "thread_alive": ("gauge", "1: the thread runs."),
    "diagnoses": ("gauge", "Diagnoses under way, by state."),
    "recordings_under_way": ("gauge", "Recordings of streams that are under way."),
    "recordings_free_bytes": ("gauge", "Left for recordings on their disk."),
    "link_up": ("gauge", "1: the drive streams."),
    "link_reconnects_total": ("counter", "Times the link came back."),
    "stream_rows_per_second": ("gauge", "Rows that came, over the last 2 s."),
    "stream_rows_total": ("counter", "Rows that came."),
    "stream_gaps_total": ("counter", "Breaks between rows."),
    "stream_rows_lost_total": ("counter", "Rows that the drive made and that never came."),
    "stream_clock_resets_total": ("counter", "Times the drive's clock began anew."),
    "stream_age_seconds": ("gauge", "Since the end of the latest row."),
    "operation_enabled": ("gauge", "1: the bridge is on, by CiA 402."),
    "fault_code": ("gauge", "CiA 402 error code of the drive's fault; 0: in none."),
    "winding_temperature_celsius": ("gauge", "As the drive tells it."),
    "magnet_temperature_celsius": ("gauge", "As the drive tells it."),
    "estimate_status": ("gauge", "1: how far the parameter is told now."),
    "resistance_ohm": ("gauge", "R_s, as estimated now."),
    "resistance_standard_error_ohm": ("gauge", "Of R_s."),
    "inductance_henry": ("gauge", "L_d and L_q, as estimated now."),
    "inductance_standard_error_henry": ("gauge", "Of L_d and L_q."),
    "magnet_flux_linkage_weber": ("gauge", "psi_f, peak, as estimated now."),
    "magnet_flux_linkage_standard_error_weber": ("gauge", "Of psi_f."),
}

Told = tuple[str, float | None, dict[str, str]]  # family, value (None: not known), labels


def metrics_text(service: Service, version: str) -> str:
    """All metrics of a service as they are now."""
    samples = dict[str, list[str]]()
    for family, value, labels in _all(service, version):
        if value is not None and math.isfinite(value):
            samples.setdefault(family, []).append(f"{_PREFIX}{family}{_labels(labels)} {value:.15g}")
    lines = list[str]()
    for family, (kind, said) in _FAMILIES.items():
        if family in samples:
            name = f"{_PREFIX}{family}"
            lines += [f"# HELP {name} {said}", f"# TYPE {name} {kind}", *samples[family]]
    return "\n".join([*lines, ""])


def _all(service: Service, version: str) -> Iterator[Told]:
    yield from _of_service(service, version)
    for name in service.drives:
        for of in (_of_stream, _of_drive, _estimates):
            for family, value, labels in of(service, name):
                yield family, value, {"drive": name} | labels


def _of_service(service: Service, version: str) -> Iterator[Told]:
    diagnoses = service.diagnoses.under_way_by_state()
    yield "info", 1, {"version": version}
    yield "uptime_seconds", service.uptime, {}
    for thread in service.threads():
        yield "thread_alive", int(thread.alive), {"thread": thread.name}
    for state in ("queued", "running"):
        yield "diagnoses", diagnoses[state], {"state": state}
    yield "recordings_under_way", service.recordings.under_way_by_state().total(), {}
    yield "recordings_free_bytes", service.free_bytes, {}


def _of_stream(service: Service, name: str) -> Iterator[Told]:
    link = service.link(name)
    yield "link_up", int(link.state is LinkState.STREAMING), {}
    yield "link_reconnects_total", link.reconnects, {}
    yield "stream_rows_per_second", link.rate, {}
    yield "stream_rows_total", link.rows, {}
    yield "stream_gaps_total", link.gaps, {}
    yield "stream_rows_lost_total", link.rows_lost, {}
    yield "stream_clock_resets_total", link.clock_resets, {}
    yield "stream_age_seconds", link.age, {}


def _of_drive(service: Service, name: str) -> Iterator[Told]:
    now, latest = service.control(name).state, service.latest(name)
    if service.link(name).state is not LinkState.STREAMING:
        return
    if now is not None:
        yield "operation_enabled", int(now.state is State.OPERATION_ENABLED), {}
        yield "fault_code", now.fault.code if now.fault else 0, {}
    if latest is not None:
        yield "winding_temperature_celsius", latest.temp_winding, {}
        yield "magnet_temperature_celsius", latest.temp_magnet, {}


def _estimates(service: Service, name: str) -> Iterator[Told]:
    for parameter, estimate in service.estimates(name).result.estimates.items():
        what, unit, labels = _PARAMETERS[parameter]
        for status in Status:
            yield "estimate_status", int(estimate.status is status), {"parameter": parameter, "status": str(status)}
        if estimate.status in _ESTIMATED:
            yield f"{what}_{unit}", estimate.value, labels
            yield f"{what}_standard_error_{unit}", estimate.std, labels


def _labels(labels: dict[str, str]) -> str:
    escaped = {key: said.replace("\\", r"\\").replace('"', r"\"").replace("\n", r"\n") for key, said in labels.items()}
    return "{" + ",".join(f'{key}="{said}"' for key, said in escaped.items()) + "}" if labels else ""
