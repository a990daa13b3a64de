"""Test vectors: a stream, and what `online.window_ls` says of it, as a header for `pmsm_check.c`.

Knows nothing of folders.
"""

from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np

from estimator.export_c.module import Module
from estimator.export_c.stream import MACHINE, T_S, Stream, stream_for
from estimator.machine import PARAMETERS
from estimator.online import window_ls
from estimator.online.estimate import Status, WindowEstimate
from estimator.samples import Samples

STALE: Final = 8000  # ticks
_FEWEST: Final = 30  # rows that single precision can tell something of
_OFF: Final = 1.1  # times its value is what is known of a parameter that is estimated


def statuses(result: WindowEstimate) -> dict[str, Status]:
    """Statuses as the module has them: where a parameter comes out as no motor has it, all that is told is doubtful."""
    doubted = {Status.OK: Status.DOUBTFUL} if result.impossible else {}
    return {name: doubted.get(e.status, e.status) for name, e in result.estimates.items()}


def known_values(module: Module) -> dict[str, float]:
    """What the vectors' drive knows: parameters that are held, and the others not quite."""
    return {
        name: getattr(MACHINE, name) * (_OFF if name in module.estimated else 1.0) for name in PARAMETERS
    }


def header(module: Module) -> str:
    """`pmsm_vectors.h`."""
    stream, known = stream_for(module.window), known_values(module)
    rows = [f"{{{tick}u, {{{', '.join(_number(value) for value in sample)}}}}}," for tick, sample in
            zip(stream.ticks, stream.samples, strict=True)]
    said = [_moment(module, *moment) for moment in _expected(module, stream, known)]
    return "\n".join([
        "/* Samples, and what pmsm-bench says of them: see pmsm_check.c. */",
        '#include "pmsm_window.h"',
        "",
        "#include <math.h>",
        "",
        "#define V(x) ((pmsm_real)(x))",
        "",
        f"static const pmsm_settings SETTINGS = {{V({T_S!r}), {{{_listed(known)}}}, V(0), V(0), V(0), {STALE}u}};",
        "",
        "static const struct { uint32_t tick; pmsm_sample sample; } SAMPLES[] = {",
        *(f"    {row}" for row in rows),
        "};",
        "",
        "/* After so many samples, asked at a tick. */",
        "static const struct { uint32_t samples, tick; pmsm_estimates said; } MOMENTS[] = {",
        *(f"    {each}" for each in said),
        "};",
        "",
    ])


def _number(value: float) -> str:
    return f"V({value:.9g})" if np.isfinite(value) else "V(NAN)"


def _listed(values: Mapping[str, float]) -> str:
    return ", ".join(f"V({values[name]!r})" for name in PARAMETERS)


def _expected(
    module: Module, stream: Stream, known: Mapping[str, float]
) -> Iterator[tuple[int, int, WindowEstimate, Mapping[str, Status]]]:
    """After how many samples, asked when, and what is said."""
    state, done = window_ls.init(module.window), 0
    for moment in stream.moments:
        for at in range(done, moment):
            joins = at > 0 and stream.ticks[at] == stream.ticks[at - 1] + 1
            _, _, i_d, i_q, u_d, u_q = (stream.samples[at : at + 1, j].copy() for j in range(6))
            theta_e = stream.theta_e[at : at + 1]
            sample = Samples(theta_e, np.zeros(1), i_d, i_q, u_d, u_q, T_S)
            window_ls.update(state, sample, joined=bool(joins))
        done = moment
        result = window_ls.estimate(state, module.estimated, known)
        if len(module.estimated) < 2 * result.samples and result.samples < _FEWEST:
            continue
        said, tick = statuses(result), int(stream.ticks[moment - 1])
        yield moment, tick, result, said
        if moment == stream.moments[-2]:
            old = {Status.OK: Status.STALE, Status.DOUBTFUL: Status.STALE}
            yield moment, tick + STALE + 1, result, {name: old.get(s, s) for name, s in said.items()}


def _moment(
    module: Module, samples: int, tick: int, result: WindowEstimate, said: Mapping[str, Status]
) -> str:
    told = {name: e.std is not None for name, e in result.estimates.items()}
    known = known_values(module)
    values = ", ".join(
        f"V({(e.value if told[name] and e.value is not None else known[name])!r})"
        for name, e in result.estimates.items()
    )
    stds = ", ".join(f"V({e.std if e.std is not None else 0.0!r})" for e in result.estimates.values())
    names = ", ".join(f"PMSM_{status.name}" for status in said.values())
    residual = result.residual_rms or 0.0
    return (
        f"{{{samples}u, {tick}u, {{{{{values}}}, {{{stds}}}, {{{names}}}, V({residual!r}), "
        f"{result.samples}u, {result.gaps}u}}}},"
    )
