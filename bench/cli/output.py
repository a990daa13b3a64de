"""Files that a command writes because an option says so."""

from pathlib import Path

from bench.errors import ConfigError


def check_new(option: str, path: Path) -> None:
    """Raise ConfigError where a file with something in it would be lost. Pipes and devices take what they are given."""
    try:
        lost = path.is_file() and path.stat().st_size > 0
    except OSError:
        return  # writing it says why
    if lost:
        raise ConfigError(f"{option}: {path} exists already, expected a new file")
