"""Debian's kernel, unpacked and not installed: its image, and the modules that are asked for. Knows apt and dpkg."""

import lzma
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

PACKAGE = "linux-image-amd64"  # depends on the latest


class KernelError(Exception):
    """There is no kernel to boot; the sentence says why."""


@dataclass(frozen=True, slots=True)
class Kernel:
    """An unpacked kernel package."""

    folder: Path

    @property
    def image(self) -> Path:
        """What a machine boots."""
        return self._only("boot/vmlinuz-*")

    def modules(self, names: list[str]) -> list[tuple[str, bytes]]:
        """Name and content of modules and of all that they need, each after what it needs."""
        found: dict[str, bytes] = {}
        for name in names:
            self._add(name, found)
        return list(found.items())

    def _add(self, name: str, found: dict[str, bytes]) -> None:
        if name in found or self._is_built_in(name):
            return
        content = _content(self._only(f"**/{name}.ko*"))
        depends = re.search(rb"(?<=\0)depends=([^\0]*)\0", content)
        for other in filter(None, depends[1].decode().split(",") if depends else []):
            self._add(other, found)
        found[name] = content

    def _is_built_in(self, name: str) -> bool:
        return f"/{name}.ko\n" in self._only("**/modules.builtin").read_text()

    def _only(self, pattern: str) -> Path:
        files = list(self.folder.glob(pattern))
        if len(files) != 1:
            raise KernelError(f"expected one {pattern} in {self.folder}, found {len(files)}; remove it to begin anew")
        return files[0]


def unpacked(folder: Path) -> Kernel:
    """The kernel in a folder; fetched and unpacked there when the folder does not exist. Raises KernelError."""
    if not folder.exists():
        half = folder.with_name(folder.name + ".half")
        shutil.rmtree(half, ignore_errors=True)
        half.mkdir(parents=True)
        _said("apt-get", "download", "--quiet", "--quiet", _latest(), within=half)
        (package,) = half.glob("*.deb")
        _said("dpkg-deb", "--extract", str(package), str(half))
        package.unlink()
        half.rename(folder)
    return Kernel(folder)


def _latest() -> str:
    """The package that holds the latest kernel."""
    lines = _said("apt-cache", "depends", PACKAGE).split()
    names = [word for word in lines if re.fullmatch(r"linux-image-[0-9][^<>]*", word)]
    if not names:
        raise KernelError(f"apt knows no package {PACKAGE}; `apt-get update` may help")
    return names[0]


def _said(*command: str, within: Path | None = None) -> str:
    """What a command printed. Raises KernelError."""
    try:
        done = subprocess.run(command, cwd=within, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        raise KernelError(f"no {command[0]} here: Debian's kernel is fetched with apt and dpkg") from None
    if done.returncode:
        raise KernelError(f"`{' '.join(command)}` failed: {done.stderr.strip()}")
    return done.stdout


def _content(module: Path) -> bytes:
    """A module, decompressed where it is compressed."""
    data = module.read_bytes()
    return lzma.decompress(data) if module.suffix == ".xz" else data
