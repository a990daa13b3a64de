"""Files that a command writes because an option says so."""

from pathlib import Path

from bench.capture_file import check_place
from bench.errors import ConfigError


def check_new(option: str, path: Path) -> None:
    """Raise ConfigError where a file with something in it would be lost. Pipes and devices take what they are given."""
    try:
        lost = path.is_file() and path.stat().st_size > 0
    except OSError:
        return  # writing it says why
    if lost:
        raise ConfigError(f"{option}: {path} exists already, expected a new file")


def check_recording(path: Path) -> None:
    """Raise ConfigError, before anything is recorded, where `--out` is no new Parquet file that can be written."""
    if path.suffix != ".parquet":
        raise ConfigError(f"--out: expected a file name that ends in .parquet, got {str(path)!r}")
    if path.exists():
        raise ConfigError(f"--out: {path} exists already, expected a new file")
    if not path.parent.is_dir():
        raise ConfigError(f"--out: there is no folder {path.parent}")
    try:
        check_place(path)
    except OSError as error:
        raise ConfigError(f"no recording can be written in {path.parent}: {error.strerror or error}") from None
