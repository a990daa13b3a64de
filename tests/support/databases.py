"""Databases of tests: a file of SQLite, and a PostgreSQL of one's own, where the machine has one."""

import contextlib
import os
import shutil
import subprocess
from collections.abc import Generator
from pathlib import Path

import pytest

from tests.conftest import free_port

_TOOLS = ("initdb", "pg_ctl")


def _tool(name: str) -> str | None:
    """A program of PostgreSQL's: Debian has them beside each other by version."""
    found = sorted(Path("/usr/lib/postgresql").glob(f"*/bin/{name}"))
    return str(found[-1]) if found else shutil.which(name)


@contextlib.contextmanager
def postgresql(folder: Path) -> Generator[str]:
    """The address of an empty PostgreSQL that runs as long; skips, and says so, where there is none."""
    tools = {name: _tool(name) for name in _TOOLS}
    if missing := [name for name, path in tools.items() if path is None]:
        pytest.skip(f"PostgreSQL is not installed (Debian: postgresql): {', '.join(missing)} missing")
    user: list[str] = []
    if not os.geteuid():  # its server refuses to be root's
        if shutil.which("runuser") is None:
            pytest.skip("PostgreSQL does not run as root, and there is no runuser")
        user = ["runuser", "-u", "nobody", "--"]
        shutil.chown(folder, "nobody")
        for above in folder.parents:
            if above.stat().st_uid == 0 and not above.stat().st_mode & 0o001:
                above.chmod(above.stat().st_mode | 0o011)
    data, port = folder / "data", free_port()

    def run(*command: str | None) -> None:
        done = subprocess.run([*user, *filter(None, command)], capture_output=True, text=True, check=False, cwd="/")
        assert done.returncode == 0, done.stdout + done.stderr

    run(tools["initdb"], "--auth=trust", "--username=bench", "--no-sync", "-D", str(data))
    options = f"-p {port} -k {data} -c listen_addresses=127.0.0.1 -c fsync=off"
    run(tools["pg_ctl"], "-D", str(data), "-o", options, "-l", str(data / "log"), "-w", "start")
    try:
        yield f"postgresql://bench@127.0.0.1:{port}/postgres"
    finally:
        run(tools["pg_ctl"], "-D", str(data), "-m", "immediate", "-w", "stop")
