"""An emulated PC under QEMU that boots a kernel, sees the host's files and runs one command. Knows QEMU.

Its clock counts a nanosecond an instruction: a host that is slow or busy makes the machine take longer, not miss its
times. Only while it has nothing to do does its time pass with the host's.
"""

import shlex
import shutil
import subprocess
from pathlib import Path

from tests.vcan.initramfs import archive
from tests.vcan.kernel import Kernel

MODULES = ["virtio_pci", "9pnet_virtio", "9p", "overlay", "vcan", "can-raw"]
QEMU = "qemu-system-x86_64"
_CLOCK = "shift=0"  # 2**0 ns an instruction
_KERNEL_OPTIONS = "console=ttyS0 quiet panic=-1 mitigations=off tsc=reliable clocksource=tsc"  # the latter: quicker
_FOLDERS = ["bin", "dev", "host", "modules", "proc", "root", "sys", "written"]


class MachineError(Exception):
    """The machine did not run, or not to its end; the sentence says why."""


def run(kernel: Kernel, folder: Path, command: str, timeout: float) -> int:
    """Exit status of a shell command that is run in a machine of its own, which sees this one's files.

    Its output comes as it is made; what it writes is gone afterwards. `folder` takes the machine's own files, `timeout`
    is in s. Raises MachineError.
    """
    qemu, busybox = found(QEMU, "qemu-system-x86"), found("busybox", "busybox-static")
    initramfs, status = folder / "initramfs", folder / "status"
    initramfs.write_bytes(_initramfs(kernel, Path(busybox), command))
    status.unlink(missing_ok=True)
    machine = [
        qemu, "-machine", "q35", "-accel", "tcg", "-icount", _CLOCK, "-cpu", "max", "-m", "2048",
        "-no-reboot", "-display", "none", "-vga", "none", "-nic", "none", "-monitor", "none",
        "-kernel", str(kernel.image), "-initrd", str(initramfs), "-append", _KERNEL_OPTIONS,
        "-virtfs", "local,path=/,mount_tag=host,security_model=none,readonly=on,multidevs=remap",
        "-serial", "stdio", "-serial", f"file:{status}",
    ]
    with subprocess.Popen(machine, stdin=subprocess.DEVNULL) as process:
        try:
            process.wait(timeout)
        except subprocess.TimeoutExpired:
            raise MachineError(f"the machine was not done after {timeout / 60:g} minutes") from None
        finally:
            process.kill()
    said = status.read_text().strip() if status.exists() else ""
    if not said:
        raise MachineError("the machine ended before the tests did")
    return int(said)


def _initramfs(kernel: Kernel, busybox: Path, command: str) -> bytes:
    modules = kernel.modules(MODULES)
    settings = f"modules={shlex.quote(' '.join(name for name, _ in modules))}\ncommand={shlex.quote(command)}\n"
    files = {
        "init": Path(__file__).with_name("init.sh").read_bytes(),
        "bin/busybox": busybox.read_bytes(),
        "settings": settings.encode(),
        **{f"modules/{name}.ko": content for name, content in modules},
    }
    return archive(_FOLDERS, files)


def found(program: str, package: str) -> str:
    """Where a program is. Raises MachineError, with the Debian package that has it, where it is not."""
    path = shutil.which(program)
    if path is None:
        raise MachineError(f"no {program} here: it is in Debian's package {package}")
    return path
