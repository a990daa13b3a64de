"""The token that is asked for beyond loopback: its file, who may read it, another one in its place."""

import os
import stat
import subprocess
from pathlib import Path

import pytest

from bench.errors import ConfigError
from bench.service.token import Known, made, read, renewed
from tests.conftest import COMMAND


def test_a_token_is_made_once_and_its_owner_alone_may_read_it(tmp_path: Path) -> None:
    path = tmp_path / "data" / "token"
    token = made(path)
    assert len(token) >= 43  # 256 bits
    assert made(path) == read(path) == token
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert made(tmp_path / "another") != token


def test_a_new_token_takes_the_place_of_the_one_before_and_nothing_is_left_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "token"
    before = made(path)
    assert renewed(path) == read(path) != before
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o644, 0o620])
def test_a_token_that_others_may_read_or_write_is_refused(tmp_path: Path, mode: int) -> None:
    path = tmp_path / "token"
    made(path)
    path.chmod(mode)
    with pytest.raises(ConfigError, match=rf"that its owner alone may read \(chmod 600\), got mode {mode:04o}"):
        made(path)


@pytest.mark.parametrize("text", [b"", b"short", b"x" * 5000, b"\xff" * 40, b"a b" * 20, b"a" * 40 + b"\n" + b"b" * 40])
def test_a_file_that_holds_no_token_is_refused_and_stays_as_it_is(tmp_path: Path, text: bytes) -> None:
    path = tmp_path / "token"
    path.write_bytes(text)
    path.chmod(0o600)
    with pytest.raises(ConfigError, match="as `pmsm-bench token` makes it, got another text") as refused:
        made(path)
    assert path.read_bytes() == text
    assert "short" not in str(refused.value).removeprefix(str(path))


def test_a_pipe_or_a_folder_in_a_tokens_place_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe", 0o600)
    (tmp_path / "folder").mkdir(0o700)
    for name in ("pipe", "folder"):
        with pytest.raises(ConfigError, match="expected a file with a token, got something else"):
            made(tmp_path / name)


def test_a_folder_that_cannot_be_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for make in (made, renewed):
        with pytest.raises(ConfigError, match="the token cannot be written: "):
            make(tmp_path / "file" / "token")


def test_a_service_goes_by_a_new_token_within_a_second_and_by_none_while_it_is_gone(tmp_path: Path) -> None:
    path, now = tmp_path / "token", 0.0
    known = Known(path, lambda: now)
    first = known.now
    assert first is not None
    second = renewed(path)
    assert known.is_it(first)
    now = 1.1
    assert known.is_it(second)
    assert not known.is_it(first)
    path.unlink()
    now = 2.2
    assert known.now is None
    assert not known.is_it("")
    assert not known.is_it(second)


def test_the_command_prints_the_token_alone_and_makes_another_when_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))

    def printed(*options: str) -> str:
        return subprocess.run([*COMMAND, "token", *options], capture_output=True, text=True, check=True).stdout

    first = printed()
    assert first == f"{read(tmp_path / 'pmsm-bench/token')}\n" == printed()
    assert printed("--new") == f"{read(tmp_path / 'pmsm-bench/token')}\n" != first
    config = tmp_path / "bench.toml"
    drive = 'url = "canopen://socketcand/127.0.0.1:29536/can0/5"'
    config.write_text(f'[service]\ntoken = "secret"\n[drives.a]\n{drive}\n', encoding="utf-8")
    assert printed("--config", str(config)) == f"{read(tmp_path / 'secret')}\n"
