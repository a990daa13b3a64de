"""The dictionary: one table, told apart by address and name, with a checksum that notices what matters."""

import keyword
import re
from collections import Counter
from dataclasses import replace
from itertools import groupby

import pytest

from drivers.wire.canopen_od import ROW_TPDOS, TPDO_LAYOUT
from drivers.wire.codec import channel_signal
from drivers.wire.dictionary import (
    CAPTURE_DATA,
    CHANNELS,
    RESTORE_WORD,
    SIGNALS,
    STORE_WORD,
    Signal,
    WireType,
    layout_id,
    signal_at,
    signal_named,
)


def changed(signal_name: str, **fields: object) -> list[Signal]:
    """The dictionary with some fields of one signal changed."""
    return [replace(s, **fields) if s.name == signal_name else s for s in SIGNALS]  # pyright: ignore[reportArgumentType]


def test_every_address_and_every_name_is_there_once() -> None:
    assert max(Counter((s.index, s.subindex) for s in SIGNALS).values()) == 1
    assert max(Counter(s.name for s in SIGNALS).values()) == 1


def test_subindices_of_an_object_count_from_one_without_a_hole() -> None:
    for _, group in groupby(sorted(SIGNALS, key=lambda s: (s.index, s.subindex)), key=lambda s: s.index):
        subindices = [signal.subindex for signal in group]
        assert subindices in ([0], list(range(1, len(subindices) + 1)))  # a variable, or a record
        assert len(subindices) <= 254


STANDARD = {  # by CiA 301 and CiA 402
    "store": (0x1010, 1), "restore": (0x1011, 1), "error_code": (0x603F, 0), "control_word": (0x6040, 0),
    "status_word": (0x6041, 0),
}


def test_signals_stand_in_the_manufacturers_range_but_for_those_of_the_standards() -> None:
    outside = {s.name: (s.index, s.subindex) for s in SIGNALS if not 0x2000 <= s.index <= 0x5FFF}
    assert outside == STANDARD
    assert (CAPTURE_DATA[0], 1) == CAPTURE_DATA
    assert signal_at(*CAPTURE_DATA) is None


def test_what_is_written_to_make_something_happen_is_no_parameter() -> None:
    commands = {s.name for s in SIGNALS if s.access == "rw" and not s.is_parameter}
    assert commands == {"control_word", "store", "restore", "reset", "capture_command", "capture_offset"}
    assert (STORE_WORD, RESTORE_WORD) == (0x65766173, 0x64616F6C)  # "save" and "load", CiA 301


def test_every_channel_of_the_recorder_is_a_stream_signal_or_a_phase_current() -> None:
    assert CHANNELS[0] == "none"
    assert {name for name in CHANNELS[1:] if signal_named(channel_signal(name).name).index != 0x2100} == set()
    assert len(set(CHANNELS)) == len(CHANNELS)


@pytest.mark.parametrize("signal", SIGNALS, ids=lambda s: s.name)
def test_a_signal_tells_what_it_is_and_in_which_unit(signal: Signal) -> None:
    assert signal.unit
    assert signal.unit.strip() == signal.unit
    assert len(signal.summary) > 5
    assert signal.scale > 0.0
    assert re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", signal.name)
    assert not keyword.iskeyword(signal.name)
    assert str(signal) == f"0x{signal.index:04X}:{signal.subindex} ({signal.name})"


@pytest.mark.parametrize("signal", SIGNALS, ids=lambda s: s.name)
def test_bounds_belong_to_what_can_be_written_and_leave_room(signal: Signal) -> None:
    low, high = signal.minimum, signal.maximum
    if signal.access != "rw":
        assert low is None
        assert high is None
    if low is not None and high is not None:
        assert low < high or signal.name in ("store", "restore", "reset")  # one word alone does it


@pytest.mark.parametrize("signal", SIGNALS, ids=lambda s: s.name)
def test_a_full_scale_is_a_constant_of_the_same_unit_told_unscaled(signal: Signal) -> None:
    if signal.full_scale is None:
        return
    full = signal_named(signal.full_scale)
    assert (full.access, full.unit, full.full_scale, full.scale) == ("const", signal.unit, None, 1.0)
    assert signal.type is WireType.I16


def test_a_signal_is_found_by_name_and_by_address() -> None:
    for signal in SIGNALS:
        assert signal_named(signal.name) is signal
        assert signal_at(signal.index, signal.subindex) is signal


def test_an_unknown_name_is_told_with_the_names_there_are() -> None:
    names = r"it has T_s, angle_correction, .*psi_q_table_1 to _64, .*u_q"
    with pytest.raises(KeyError, match=rf"the drive has no signal 'torque'; {names}"):
        signal_named("torque")


@pytest.mark.parametrize(("index", "subindex"), [(0x2000, 0), (0x2000, 9), (0x1FFF, 1), (0x2100, 13), (-1, 1)])
def test_no_signal_is_found_at_an_address_without_one(index: int, subindex: int) -> None:
    assert signal_at(index, subindex) is None


@pytest.mark.parametrize("layout", TPDO_LAYOUT, ids=lambda layout: layout[1].name)
def test_a_pdo_fits_a_can_frame_and_begins_with_its_rows_tick(layout: tuple[Signal, ...]) -> None:
    assert layout[0].name == "row_tick"
    assert sum(signal.type.bits for signal in layout) <= 64
    assert all(signal.access == "ro" for signal in layout)


def test_the_pdos_of_a_row_carry_every_column_once() -> None:
    columns = [signal.name for layout in TPDO_LAYOUT[:ROW_TPDOS] for signal in layout[1:]]
    assert sorted(columns) == sorted(
        ["theta_e", "omega_e", "i_d", "i_q", "u_d", "u_q", "i_d_mean", "i_q_mean", "u_dc"]
    )


@pytest.mark.parametrize(
    ("name", "fields"),
    [
        ("theta_e", {"scale": 1e-4}),
        ("T_s", {"scale": 1.0000001e-9}),
        ("i_d", {"type": WireType.I32}),
        ("i_d", {"type": WireType.U16}),
        ("bandwidth", {"index": 0x2201}),
        ("bandwidth", {"subindex": 7}),
        ("u_dc", {"full_scale": "i_full"}),
        ("u_dc", {"full_scale": None}),
        ("temp_winding", {"unit": "K"}),
        ("i_d_mean", {"name": "i_d_average"}),
    ],
)
def test_the_checksum_notices_whatever_makes_the_same_bytes_mean_something_else(
    name: str, fields: dict[str, object]
) -> None:
    assert layout_id(changed(name, **fields)) != layout_id()


def test_the_checksum_does_not_care_for_words_and_bounds() -> None:
    assert layout_id(changed("bandwidth", summary="how fast", maximum=2e4)) == layout_id()


def test_the_checksum_notices_a_signal_more_or_less_and_another_order() -> None:
    same = layout_id(SIGNALS)
    assert same == layout_id()
    assert layout_id(SIGNALS[:-1]) != same
    assert layout_id(SIGNALS[::-1]) != same
    assert 0 <= same < 1 << 32
