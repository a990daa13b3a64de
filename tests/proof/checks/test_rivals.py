"""What other methods make of a recording: they are fitted and judged apart, and do what they are known for."""

from pathlib import Path

import numpy as np
import pytest

from emulator.conceal.files import write
from emulator.conceal.recording import Choice, drawn
from estimator.machine import Machine
from estimator.samples import Samples
from tests.proof.parts import rivals
from tests.score.diagnosed import loaded

SEED, NUMBER, LENGTH = 1000, 120, 1.5  # s; a run with an encoder and converters so fine that noise is white
Recording = tuple[list[Samples], Machine, dict[str, float]]


@pytest.fixture(scope="module", params=["none", "dead_time"])
def recording(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Recording]:
    """Rows, nominal machine and true one of a class."""
    folder: Path = tmp_path_factory.mktemp("rivals")
    choice = Choice(SEED, (request.param,), (0.9, 0.9), ("servo_4nm",), LENGTH)
    concealed, columns = drawn(choice, NUMBER)
    write(concealed, columns, choice, "recording", folder, folder)
    runs, nominal = loaded(folder, "recording")
    return request.param, (runs, nominal, concealed.scenario.motor._asdict())


def test_what_is_judged_took_no_part_in_the_fit(recording: tuple[str, Recording]) -> None:
    _, (runs, _, _) = recording
    pieces = list(rivals.pieces(runs))
    assert [judged for _, judged in pieces[:4]] == [False, True, False, True]
    assert sum(len(piece) for piece, _ in pieces) == sum(map(len, runs))
    blocks = rivals.blocks_of(runs)
    assert len(blocks.balance) == sum((len(piece) - 1) // rivals.M for piece, _ in pieces)
    assert np.mean(blocks.judged) == pytest.approx(0.5, abs=0.02)


def test_least_squares_read_dead_time_as_resistance_and_whiteness_tells_that_something_is_left(
    recording: tuple[str, Recording],
) -> None:
    kind, (runs, nominal, true) = recording
    blocks = rivals.blocks_of(runs)
    window = rivals.wls(runs, blocks, nominal)
    off = abs((window.values["R_s"] or 0.0) / true["R_s"] - 1.0)
    p = rivals.whiteness(blocks, window.values, nominal)
    assert (off < 0.02, p > 1e-3) == ((True, True) if kind == "none" else (False, False))


def test_learnt_models_miss_less_where_something_is_concealed_and_no_less_where_nothing_is(
    recording: tuple[str, Recording],
) -> None:
    pytest.importorskip("pysindy")
    kind, (runs, nominal, true) = recording
    blocks = rivals.blocks_of(runs)
    window = rivals.wls(runs, blocks, nominal)
    sparse, box = rivals.sparse(blocks, nominal), rivals.black_box(blocks, window.values, nominal)
    if kind == "none":
        assert sparse.missed == pytest.approx(window.missed, rel=0.1)
        assert box.missed > 0.97 * window.missed
        assert sparse.values["L_d"] == pytest.approx(true["L_d"], rel=0.1)
    else:
        assert sparse.missed < 0.8 * window.missed
        assert box.missed < 0.8 * window.missed
        assert "sign" in sparse.says or "beyond" in sparse.says
