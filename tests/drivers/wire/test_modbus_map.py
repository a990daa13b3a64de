"""Modbus's view of the dictionary: where each signal is, and that every value survives the way."""

import itertools
import json
import math
import struct
import sys
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.cli.main import main
from drivers.wire import modbus_map as registers
from drivers.wire.codec import decode, encode_held
from drivers.wire.dictionary import SIGNALS, Signal, WireType, signal_named

FULL = {"i_full": 24.0, "u_full": 387.5, "omega_full": 2982.9763}


@pytest.mark.parametrize(
    ("name", "address"),
    [  # by hand: area + 16 (index & 0xFFF) + 2 subindex
        ("layout_id", 0x1002), ("stream_periods", 0x1008), ("i_full", 0x1102), ("theta_e", 0x2004), ("i_q_ref", 0x4004),
        ("capture_offset", 0x5028), ("control_word", 0x8400), ("status_word", 0x8410), ("error_code", 0x83F0),
        ("store", 0x9102), ("restore", 0x9112),
    ],
)
def test_a_signal_is_where_the_rule_says(name: str, address: int) -> None:
    assert registers.address_of(signal_named(name)) == address
    assert registers.signal_at_register(address) is signal_named(name)


def test_every_signal_has_registers_of_its_own_beside_head_request_and_window() -> None:
    spans = [(registers.address_of(s), registers.address_of(s) + 2) for s in SIGNALS]
    spans += [(registers.HEAD, registers.HEAD + registers.HEAD_LENGTH)]
    spans += [(registers.REQUEST, registers.REQUEST + registers.REQUEST_LENGTH)]
    spans += [(registers.WINDOW, registers.WINDOW + registers.MOST_READ)]
    spans.sort()
    assert len(spans) == len(SIGNALS) + 3
    assert all(end <= begin for (_, end), (begin, _) in itertools.pairwise(spans))
    assert spans[-1][1] <= 0x10000


def test_a_signal_added_at_the_end_of_its_record_moves_no_other() -> None:
    records = {signal.index: signal for signal in SIGNALS if signal.subindex}  # the last of each
    for last in records.values():
        added = replace(last, name="added", subindex=last.subindex + 1)
        address = registers.address_of(added)
        assert address == registers.address_of(last) + 2
        assert registers.signal_at_register(address) is None


def test_the_high_word_comes_first() -> None:
    assert registers.words_of(signal_named("tick"), struct.pack("<I", 0x0001_0002)) == [0x0001, 0x0002]
    assert registers.words_of(signal_named("i_q_ref"), struct.pack("<f", 1.0)) == [0x3F80, 0x0000]
    assert registers.words_of(signal_named("i_d"), struct.pack("<h", -2)) == [0xFFFE]


@given(signal=st.sampled_from(SIGNALS), type_=st.sampled_from(WireType), data=st.binary(min_size=4, max_size=4))
@settings(deadline=None)
def test_every_value_of_every_type_survives(signal: Signal, type_: WireType, data: bytes) -> None:
    typed = replace(signal, type=type_)
    value = data[: type_.bits // 8]
    words = registers.words_of(typed, value)
    assert len(words) == registers.length_of(typed)
    assert registers.bytes_of(typed, words) == value


@given(signal=st.sampled_from(SIGNALS), data=st.data())
@settings(deadline=None)
def test_every_value_that_a_drive_holds_comes_back_the_same(signal: Signal, data: st.DataObject) -> None:
    size = signal.type.bits // 8
    held = data.draw(st.binary(min_size=size, max_size=size))
    try:
        value = decode(signal, held, FULL)
    except ValueError:
        return  # no number
    low = -math.inf if signal.minimum is None else signal.minimum
    high = math.inf if signal.maximum is None else signal.maximum
    if math.isnan(value) or signal.full_scale or low <= value <= high:
        words = registers.words_of(signal, encode_held(signal, value, FULL))
        again = decode(signal, registers.bytes_of(signal, words), FULL)
        assert again == value or (math.isnan(again) and math.isnan(value))


@given(st.sets(st.sampled_from(SIGNALS)))
@settings(deadline=None)
def test_blocks_hold_every_signal_once_and_each_fits_one_request(chosen: set[Signal]) -> None:
    blocks = registers.blocks(chosen)
    assert sorted(s.name for block in blocks for s in block) == sorted(s.name for s in chosen)
    for block in blocks:
        addresses = [registers.address_of(s) for s in block]
        assert addresses == list(range(addresses[0], addresses[0] + 2 * len(block), 2))
        assert 2 * len(block) <= registers.MOST_REGISTERS


def test_all_parameters_take_few_requests() -> None:
    assert len(registers.blocks(s for s in SIGNALS if s.is_parameter)) <= 20


def test_the_head_comes_back_the_same_and_begins_with_the_layout() -> None:
    head = registers.our_head(0x1234_5678, 7)
    assert head.words()[:2] == [0x1234, 0x5678]
    assert len(head.words()) == registers.HEAD_LENGTH
    assert registers.Head.of(head.words()) == head
    assert (head.device_name, head.product_code) == ("pmsm-bench virtual drive", 0x504D534D)


@given(st.lists(st.integers(0, 0xFFFF), min_size=registers.HEAD_LENGTH, max_size=registers.HEAD_LENGTH))
@settings(deadline=None)
def test_any_registers_are_some_head(words: list[int]) -> None:
    assert registers.Head.of(words).layout_id == words[0] << 16 | words[1]


@given(st.lists(st.integers(0, 0xFFFF), min_size=16, max_size=registers.MOST_READ))
@settings(deadline=None)
def test_any_registers_are_rows_and_samples_or_told_not_to_be(words: list[int]) -> None:
    window = registers.Window.of(words)
    for kind in (registers.Rows, registers.Samples):
        try:
            found = kind.of(window)
        except ValueError as error:
            assert "at most" in str(error)
        else:
            held = len(found.rows) if isinstance(found, registers.Rows) else len(found.counts) // 2
            assert held == window.count * (1 if kind is registers.Rows else getattr(found, "channels", 0))


def test_a_row_and_a_sample_are_taken_apart_as_by_hand() -> None:
    rows = registers.Rows.of(registers.Window.of([
        7, 2, 0, 100, 1,  # number, kind, first, count
        0, 101, 0x0001, 0x86A0, 10, 2340, 0xFFFF,  # made, tick, periods, temperatures
        0x8000, 1, 2, 3, 4, 0xFFFF, 6, 7, 8,
    ]))
    assert (rows.first, rows.made, rows.tick, rows.periods) == (100, 101, 100_000, 10)
    assert rows.temperatures == pytest.approx((23.4, -0.01))
    assert rows.rows.tolist() == [[-0x8000, 1, 2, 3, 4, -1, 6, 7, 8]]
    samples = registers.Samples.of(registers.Window.of([7, 3, 0, 5, 2, 3, 2, 0x0102, 0x0304, 0x0506, 0x0708, 0]))
    assert (samples.number, samples.channels) == (3, 2)
    assert samples.counts == bytes([2, 1, 4, 3, 6, 5, 8, 7])


def test_registers_have_names_for_messages() -> None:
    assert registers.name_of(0x1004) == "register 0x1004 (T_s)"
    assert registers.name_of(0x1102, 6) == "registers 0x1102 to 0x1107 (i_full to omega_full)"
    assert registers.name_of(registers.HEAD, 26) == "register 0x0000 (identity)"
    assert registers.name_of(0x7777) == "register 0x7777"


def printed(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *options: str) -> str:
    monkeypatch.setattr(sys, "argv", ["pmsm-bench", "registers", *options])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    return capsys.readouterr().out


def test_the_map_is_printed_as_json(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    lines = json.loads(printed(monkeypatch, capsys, "--json"))
    by_name = {line["name"]: line for line in lines if line["address"] >= 0x1000}
    assert set(by_name) == {signal.name for signal in SIGNALS}
    assert by_name["i_q"] == {
        "address": 0x2008, "registers": 1, "name": "i_q", "type": "I16", "unit": "A", "scale": 1.0 / 32768.0,
        "full_scale": "i_full", "access": "ro", "summary": "q-axis current at the row's start",
    }
    assert lines[0]["name"] == "layout_id"


def test_the_map_is_printed_as_a_table(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    table = printed(monkeypatch, capsys)
    assert "the high word first" in table
    (line,) = [line for line in table.splitlines() if " i_q_ref " in line]
    assert [cell.strip() for cell in line.split("│")[1:-1]] == [
        "16388", "0x4004", "2", "i_q_ref", "F32", "A", "rw", "q-axis current reference"
    ]
