"""What a drive tells of its memory for parameters, by `memory_state`: a count each."""

from enum import IntEnum


class MemoryState(IntEnum):
    """What the drive runs with since its latest reset, or that it is storing."""

    DELIVERED = 0
    NEWEST = 1
    OLDER = 2
    WRITING = 3

    @property
    def words(self) -> str:
        """As the drive's manual has it."""
        return (
            "as delivered", "the newest that were stored", "those before, since the newest were cut", "being stored"
        )[self]  # fmt: skip
