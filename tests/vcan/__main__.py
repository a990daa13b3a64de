"""`python -m tests.vcan [PYTEST OPTIONS]`: the tests marked `vcan`, in a machine with vcan0. See the package's page."""

import os
import shlex
import subprocess
import sys
import time
from pathlib import Path

from tests.vcan.kernel import KernelError, unpacked
from tests.vcan.machine import QEMU, MachineError, found, run

PROJECT = Path(__file__).resolve().parents[2]
FOLDER = PROJECT / "build" / "vcan"
TESTS = ["tests/drivers/test_contract.py", "tests/vcan/test_vcan.py"]
PROGRAMS = {QEMU: "qemu-system-x86", "busybox": "busybox-static", "candump": "can-utils"}  # Debian packages
TIMEOUT = 30.0 * 60.0  # s, where others use the processor, too

# Compiled here once, for any processor: the machine's own is slow to compile for
COMPILED = {"XDG_CACHE_HOME": str(FOLDER / "cache"), "NUMBA_CPU_NAME": "generic"}
WARM_UP = "from tests.support.forked import prepare; prepare()"


def main(options: list[str]) -> int:
    """Exit status of the tests; 2 when they could not be run."""
    begun = time.monotonic()
    FOLDER.mkdir(parents=True, exist_ok=True)
    try:
        for program, package in PROGRAMS.items():
            found(program, package)
        kernel = unpacked(FOLDER / "kernel")
        subprocess.run([sys.executable, "-c", WARM_UP], cwd=PROJECT, env=os.environ | COMPILED, check=True)
        print(f"booting {kernel.image.name}, {time.monotonic() - begun:.0f} s", flush=True)
        status = run(kernel, FOLDER, command([*TESTS, *options]), TIMEOUT)
    except (KernelError, MachineError, subprocess.CalledProcessError) as error:
        print(f"test-vcan: {error}", file=sys.stderr)
        return 2
    print(f"test-vcan: exit status {status}, {time.monotonic() - begun:.0f} s")
    return status


def command(options: list[str]) -> str:
    """What the machine runs, for its shell."""
    settings = [f"{name}={value}" for name, value in {**COMPILED, "PATH": os.environ["PATH"], "HOME": "/tmp"}.items()]
    pytest = [sys.executable, "-m", "pytest", "-m", "vcan", "-vv", "--color=no", *options]
    return shlex.join(["env", "-i", "-C", str(PROJECT), *settings, *pytest])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
