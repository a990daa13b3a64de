"""The drive's memory: two pages, cut at every byte."""

from pathlib import Path

import pytest

from drivers.wire.dictionary import RESET_WORD, STORE_WORD
from drivers.wire.memory import MemoryState
from emulator.drive.control_lease import DeniedError
from emulator.drive.memory import PAGE, SPEED, Memory
from emulator.drive.virtual_drive import VirtualDrive
from emulator.scenario.scenarios import PAPER


def stored(memory: Memory, values: bytes) -> None:
    memory.store(values)
    while not memory.pass_(1.0):
        pass


def test_cut_at_any_byte_it_holds_the_values_before_or_the_new_ones(tmp_path: Path) -> None:
    first, old, new = b"the first", b"old values", b"new ones, more of them"
    most = PAGE + len(new) + 16
    for cut in (*range(30), *range(30, PAGE, 257), *range(PAGE - 3, most + 1)):
        path = tmp_path / f"{cut}"
        memory = Memory(path)
        stored(memory, first)
        stored(memory, old)
        memory.store(new)
        memory.pass_(cut / SPEED + 1e-9)
        for found in (memory, Memory(path)):  # reset; and another process after this one was killed
            found.restart()
            whole, torn = cut >= most, 0 < cut < len(first) + 16 or PAGE < cut < most
            assert found.values == (new if whole else old)
            assert found.state == (MemoryState.OLDER if torn else MemoryState.NEWEST)  # an erased page tells nothing
            assert found.count == (3 if whole else 2)
        stored(memory, b"later")
        assert (memory.values, memory.state) == (b"later", MemoryState.NEWEST)


def test_a_memory_that_was_never_written_is_as_delivered_and_one_that_was_reset_to_that_too() -> None:
    memory = Memory()
    assert (memory.state, memory.values, memory.checksum) == (MemoryState.DELIVERED, b"", 0)
    stored(memory, b"values")
    assert memory.state == MemoryState.NEWEST
    stored(memory, b"")
    assert (memory.state, memory.values, memory.count) == (MemoryState.DELIVERED, b"", 2)


def test_another_file_is_no_memory(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_bytes(b"notes")
    with pytest.raises(ValueError, match=r"notes.txt: expected a drive's memory of 8192 bytes, got another file"):
        Memory(path)
    assert path.read_bytes() == b"notes"


def test_a_drive_has_what_it_stored_after_a_reset_and_after_its_power_was_cut(tmp_path: Path) -> None:
    path = tmp_path / "memory"
    drive = VirtualDrive(PAPER, on_links=True, memory=Memory(path))
    drive.request("bandwidth", 900.0)
    drive.request("psi_d_table_64", 0.25)
    drive.request("store", STORE_WORD)
    assert drive.read("memory_state") == MemoryState.WRITING
    with pytest.raises(DeniedError):
        drive.request("reset", RESET_WORD)
    drive.run(1000)
    assert (drive.read("memory_state"), drive.read("memory_count")) == (MemoryState.NEWEST, 1)
    drive.request("bandwidth", 800.0)
    drive.request("reset", RESET_WORD)
    drive.run(10)
    assert (drive.read("bandwidth"), drive.read("psi_d_table_64"), drive.resets) == (900.0, 0.25, 1)
    drive.request("bandwidth", 700.0)
    drive.request("store", STORE_WORD)
    drive.run(450)  # 45 ms: the page is erased by then, and half written
    drive = VirtualDrive(PAPER, on_links=True, memory=Memory(path))
    assert (drive.read("bandwidth"), drive.read("memory_state")) == (900.0, MemoryState.OLDER)
    assert drive._settings.bandwidth == 900.0
    assert drive._settings.tables.psi_d_table[-1] == 0.25


def test_it_is_not_reset_while_its_bridge_is_on() -> None:
    drive = VirtualDrive(PAPER)
    with pytest.raises(DeniedError, match="not while the bridge is on"):
        drive.request("reset", RESET_WORD)
