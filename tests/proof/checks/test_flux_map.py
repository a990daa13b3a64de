"""The proof on a measured flux map: what it shows, and what it says where the map is not there."""

from pathlib import Path

import pytest

from tests.proof.parts import flux_map
from tests.proof.proof import Settings

QUICK = Settings(seed=1200, quick=True, jobs=1, folder=Path())


@pytest.mark.slow
@pytest.mark.skipif(not flux_map.FILE.exists(), reason=f"{flux_map.FILE} is not here")
def test_the_measured_map_is_recovered_and_its_saturations_named() -> None:
    proof = flux_map.prove(QUICK)
    assert len(proof.bars) == 3
    assert all(bar.held for bar in proof.bars), proof


def test_without_the_map_it_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(flux_map, "FILE", tmp_path / "nothing.npz")
    proof = flux_map.prove(QUICK)
    assert proof.bars == ()
    assert "Aalto-Electric-Drives/motulator" in proof.missing
