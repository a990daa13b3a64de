"""Which process listens at a port, is connected to one, or has a device open, as far as /proc tells this user.

Nothing is told where there is no /proc, and of other users' processes only to root. Opens no port and no device.
"""

import contextlib
import ipaddress
import os
import sys
from collections.abc import Generator
from pathlib import Path
from typing import Final

_PROC: Final = Path("/proc")
_ESTABLISHED, _LISTEN = "01", "0A"  # states in /proc/net/tcp


def listener(port: int) -> str:
    """The process that listens at a TCP port, as `python3 (4711)`; empty where that is not told."""
    inodes = {inode for state, local, _, inode in _connections() if state == _LISTEN and local[1] == port}
    return _first_with({f"socket:[{inode}]" for inode in inodes})


def connected(addresses: set[str], port: int) -> str:
    """A process here that is connected to a port of one of these addresses; `one` where which is not told; or empty."""
    inodes = {
        inode for state, _, remote, inode in _connections()
        if state == _ESTABLISHED and remote[1] == port and remote[0] in addresses
    }  # fmt: skip
    return _first_with({f"socket:[{inode}]" for inode in inodes}) or ("one" if inodes else "")


def holder(device: Path) -> str:
    """A process that has a device open; empty where none is told."""
    return _first_with({str(device.resolve())})


def _connections() -> Generator[tuple[str, tuple[str, int], tuple[str, int], str]]:
    """State, local end, remote end and inode of every TCP connection."""
    for name in ("tcp", "tcp6"):
        with contextlib.suppress(OSError):
            for line in (_PROC / "net" / name).read_text(encoding="ascii").splitlines()[1:]:
                words = line.split()
                yield words[3], _end(words[1]), _end(words[2]), words[9]


def _end(text: str) -> tuple[str, int]:
    """An address and a port, from hexadecimal in words of this machine's byte order."""
    address, _, port = text.partition(":")
    words = [int(address[k : k + 8], 16).to_bytes(4, sys.byteorder) for k in range(0, len(address), 8)]
    ip = ipaddress.ip_address(b"".join(words))
    mapped = ip.ipv4_mapped if isinstance(ip, ipaddress.IPv6Address) else None
    return str(mapped or ip), int(port, 16)


def _first_with(targets: set[str]) -> str:
    """The first process that has one of these open, by name and id."""
    if not targets:
        return ""
    for folder in _PROC.glob("[0-9]*"):
        with contextlib.suppress(OSError):
            for link in (folder / "fd").iterdir():
                with contextlib.suppress(OSError):
                    if os.readlink(link) in targets:  # noqa: PTH115 - no path: socket:[4711]
                        name = (folder / "comm").read_text(encoding="utf-8", errors="replace").strip()
                        return f"{name} ({folder.name})"
    return ""
