"""An experiment on disk while it is done: what has been uploaded so far, and the recording it becomes.

`NAME.experiment`, a `part_file`: what it is, then its recordings by the drive, one group of levels each, with counts as
they came. The recording is `NAME.parquet`; of what has not come to its end, `NAME.partial.parquet`, whose notes say so.
Knows nothing of drives under way.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, Self

import numpy as np

from bench.recordings.capture_file import column_steps, write_columns
from bench.recordings.part_file import OnPartFile, PartFile, piece_size
from drivers.capture import Setup, Upload, decoded

SUFFIX: Final = ".experiment"
_HEADING, _GROUP, _SAMPLES = b"E", b"G", b"S"


@dataclass(frozen=True, slots=True)
class Heading:
    """What an experiment is, apart from its samples."""

    origin: Mapping[str, Any]  # drive, url, asked
    device: str
    plan: Mapping[str, Any]
    T_s: float  # s
    full: Mapping[str, float]  # full scales, SI
    expected: int  # samples


class ExperimentPart(OnPartFile):
    """The part file of an experiment, grown as samples come."""

    what = "an experiment"

    def __init__(
        self, file: PartFile, heading: Heading, groups: list[Upload], remarks: Sequence[str], off: str
    ) -> None:
        """Use `begun` or `found`."""
        self.heading, self.groups, self.remarks, self.off = heading, groups, tuple(remarks), off
        super().__init__(file)

    @classmethod
    def begun(cls, recording: Path, heading: Heading) -> Self:
        """A new one beside the recording to come. Raises OSError."""
        file = PartFile.begun(recording.with_suffix(SUFFIX), _HEADING, json.dumps(asdict(heading)).encode())
        return cls(file, heading, [], (), "")

    @classmethod
    def of(cls, file: PartFile) -> Self:
        groups: list[Upload] = []
        remarks, off = list[str](), ""
        (kind, content), *rest = file.records
        if kind != _HEADING:
            raise ValueError
        heading = Heading(**json.loads(content))
        for kind, content in rest:
            if kind == _GROUP:
                told = json.loads(content)
                remarks, off = told.pop("remarks"), told.pop("off", "")
                setup = Setup(**told.pop("setup"))
                groups.append(Upload(setup, **told))
            else:
                groups[-1].data.extend(content)
        return cls(file, heading, groups, remarks, off)

    @property
    def samples(self) -> int:
        """So many there are."""
        return sum(group.done for group in self.groups)

    @property
    def complete(self) -> bool:
        """All of them."""
        return self.samples >= self.heading.expected

    def group(self, upload: Upload, remarks: Sequence[str], off: str) -> None:
        """One more recording by the drive, and all remarks so far; its samples follow. Raises OSError.

        `off`: why the drive drove no voltage after it, a clause; empty: it did.
        """
        told = {"setup": asdict(upload.setup), "number": upload.number, "tick": upload.tick, "count": upload.count}
        self.remarks, self.off = tuple(dict.fromkeys(remarks)), off
        self._file.append(_GROUP, json.dumps(told | {"remarks": self.remarks, "off": off}).encode())
        self._file.sync()
        self.groups.append(Upload(upload.setup, upload.number, upload.tick, upload.count))

    def keep(self, data: bytearray, size: int) -> None:
        """Keep the first `size` bytes of the newest group. Raises OSError."""
        kept = self.groups[-1].data
        whole = piece_size(2 * len(self.groups[-1].setup.channels))
        while len(kept) < size:
            piece = data[len(kept) : min(len(kept) + whole, size)]
            self._file.append(_SAMPLES, piece)
            kept.extend(piece)

    def written(self) -> Path:
        """What there is as a recording, whole or not at all, under the next free name. Raises OSError."""
        heading, path = self.heading, self.path.with_suffix(".parquet" if self.complete else ".partial.parquet")
        parts = [decoded(group, heading.T_s, heading.full) for group in self.groups if group.done]
        columns = {"t": np.concatenate([part.t for part in parts])}
        names = parts[0].columns
        columns |= {name: np.concatenate([part.columns[name] for part in parts]) for name in names}
        return write_columns(path, columns, {
            **heading.origin, "device": heading.device, "experiment": heading.plan, "remarks": list(self.remarks),
            "off_before": "", "off_after": self.off,
            "samples": self.samples, "expected": heading.expected, "complete": self.complete, "T_s": heading.T_s,
            "decimation": 1, "tick": parts[0].tick, "steps": column_steps(names, heading.full),
        })  # fmt: skip

    def settled(self) -> tuple[Path | None, str]:
        """End it: what there is as a recording, and in words what was kept. What cannot be written is left here."""
        samples, expected = self.samples, self.heading.expected
        if not samples:
            self.remove()
            return None, "nothing was recorded"
        try:
            path = self.written()
        except OSError as error:
            self.close()
            why = error.strerror or error
            return None, f"its first {samples} of {expected} samples are safe in {self.path}, no recording yet: {why}"
        self.remove()
        return path, f"the first {samples} of {expected} samples are kept"
