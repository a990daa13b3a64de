"""Files that lie, a few of each kind; all of them by `python -m tests.bars.mutations`."""

from pathlib import Path

import pytest

from tests.bars.mutations import FAILED, HANGS, KINDS, LIES, run

FEW = 30
SLOW = ("cells, diagnosed",)  # a diagnosis each
OTHERS = ("cells, replayed",)  # counted, and no bar of this test's: a replay takes a value for what a machine made


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in SLOW])
def test_a_changed_file_is_refused_told_or_read_to_the_same_values(kind: str, tmp_path: Path) -> None:
    found = run(kind, FEW, tmp_path)
    assert sum(found.outcomes.values()) == FEW
    assert (found.outcomes[FAILED], found.outcomes[HANGS]) == (0, 0), found.worst
    if kind not in OTHERS:
        assert found.outcomes[LIES] == 0, found.worst
