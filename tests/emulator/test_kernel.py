"""The cache of compiled functions: never stale, never growing without end."""

import os
from pathlib import Path

from numba.core import config

from emulator.frames import wrapped
from emulator.kernel import _CACHE, kernel, prune, source_hash


def test_any_change_of_any_source_gives_another_cache(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text("x = 1\n")
    (tmp_path / "b.py").write_text("y = 1\n")
    first = source_hash(tmp_path)
    (tmp_path / "notes.txt").write_text("no source")
    assert source_hash(tmp_path) == first
    (tmp_path / "b.py").write_text("y = 2\n")
    second = source_hash(tmp_path)
    (tmp_path / "b.py").rename(tmp_path / "c.py")
    assert len({first, second, source_hash(tmp_path)}) == 3


def test_old_caches_go_and_the_latest_and_the_used_stay(tmp_path: Path) -> None:
    now, day = 1e9, 86400.0
    for k in range(8):
        (tmp_path / str(k)).mkdir()
        os.utime(tmp_path / str(k), (now - k * 10 * day, now - k * 10 * day))
    prune(tmp_path, tmp_path / "7", now)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["0", "1", "2", "3", "7"]


def test_a_cache_in_recent_use_stays_however_many_there_are(tmp_path: Path) -> None:
    for k in range(8):
        (tmp_path / str(k)).mkdir()
    prune(tmp_path, tmp_path / "0", (tmp_path / "0").stat().st_mtime)
    assert len(list(tmp_path.iterdir())) == 8


def test_decorating_leaves_numbas_own_cache_folder_as_it_was() -> None:
    before = config.CACHE_DIR  # pyright: ignore[reportAttributeAccessIssue, reportUnknownVariableType]

    def double(x: float) -> float:
        return 2.0 * x

    assert kernel(double)(2.0) == 4.0
    assert before == config.CACHE_DIR  # pyright: ignore[reportAttributeAccessIssue]


def test_what_is_compiled_is_kept_in_the_folder_of_this_version() -> None:
    wrapped(1.0)
    assert _CACHE is not None
    assert any(_CACHE.rglob("frames.wrapped-*"))
    assert _CACHE.name == source_hash(Path(__file__).parents[2] / "emulator")
