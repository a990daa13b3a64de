"""An initramfs: a cpio archive in the `newc` format, which is all of a kernel's first file system."""

from dataclasses import dataclass

_REGULAR, _FOLDER = 0o100755, 0o040755


@dataclass(frozen=True, slots=True)
class _Entry:
    path: str
    mode: int
    content: bytes = b""


def archive(folders: list[str], files: dict[str, bytes]) -> bytes:
    """Folders and executable files by path, without a leading slash."""
    entries = [_Entry(path, _FOLDER) for path in folders]
    entries += [_Entry(path, _REGULAR, content) for path, content in files.items()]
    entries.append(_Entry("TRAILER!!!", 0))
    return b"".join(_packed(number, entry) for number, entry in enumerate(entries, 1))


def _packed(number: int, entry: _Entry) -> bytes:
    """Header, path and content, each to a multiple of four bytes (Linux, Documentation/driver-api/early-userspace)."""
    path = entry.path.encode() + b"\0"
    fields = {
        "inode": number, "mode": entry.mode, "uid": 0, "gid": 0, "links": 1, "mtime": 0, "size": len(entry.content),
        "major": 0, "minor": 0, "device major": 0, "device minor": 0, "path size": len(path), "check": 0,
    }
    header = b"070701" + b"".join(b"%08X" % value for value in fields.values())
    return _padded(header + path) + _padded(entry.content)


def _padded(data: bytes) -> bytes:
    return data + bytes(-len(data) % 4)
