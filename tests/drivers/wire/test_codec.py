"""Bytes and values: golden bytes made by hand, and what every value and every byte string gets."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.wire.codec import (
    channel_number,
    channel_signal,
    check_range,
    count_size,
    counts_to_si,
    decode,
    encode,
    si_to_counts,
)
from drivers.wire.dictionary import CHANNELS, SIGNALS, Signal, WireType, signal_named

FULL = {"i_full": 24.0, "u_full": 400.0, "omega_full": 3000.0}
WRITABLE = [signal for signal in SIGNALS if signal.access == "rw"]
COUNTED = [signal for signal in SIGNALS if signal.type is not WireType.F32]
ENDS = {WireType.U8: (0, 255), WireType.U16: (0, 65535), WireType.U32: (0, 4294967295),
        WireType.I16: (-32768, 32767), WireType.I32: (-2147483648, 2147483647)}


def ends(signal: Signal) -> tuple[int, int]:
    """Lowest and highest count of a known value."""
    low, high = ENDS[signal.type]
    return (low + 1 if signal.full_scale else low), high


# Little-endian, as CiA 301 has it; 32-bit floats from IEEE 754 by hand: sign, exponent + 127, fraction
GOLDEN = [
    ("layout_id", 305419896.0, "78563412"),
    ("T_s", 1e-4, "a0860100"),  # 100000 ns
    ("T_s", 6.25e-5, "24f40000"),  # 62500 ns
    ("tick", 1.0, "01000000"),
    ("tick", 4294967295.0, "ffffffff"),
    ("stream_periods", 10.0, "0a00"),
    ("stream_periods", 1000.0, "e803"),
    ("i_full", 24.0, "0000c041"),  # 1.5 * 2^4
    ("u_full", 400.0, "0000c843"),  # 1.5625 * 2^8
    ("row_tick", 65535.0, "ffff"),
    ("theta_e", math.pi, "0080"),  # half a turn
    ("theta_e", math.pi / 2.0, "0040"),
    ("i_d", 12.0, "0040"),  # half of full scale
    ("i_q", -12.0, "00c0"),
    ("i_q", 24.0 * -32767.0 / 32768.0, "0180"),  # the lowest; 0x8000 says: not known
    ("i_d_mean", 24.0 / 32768.0, "0100"),
    ("i_q_mean", -24.0 / 32768.0, "ffff"),
    ("u_d", -100.0, "00e0"),  # -8192
    ("u_dc", 300.0, "0060"),  # 24576
    ("omega_e", 1500.0, "0040"),
    ("temp_winding", 23.4, "2409"),  # 2340
    ("temp_magnet", -40.0, "60f0"),  # -4000
    ("n_p", 4.0, "0400"),
    ("control_psi_f", 0.125, "0000003e"),  # 2^-3
    ("i_d_ref", -1.0, "000080bf"),
    ("i_q_ref", 2.5, "00002040"),  # 1.25 * 2^1
    ("step_time", 0.5, "0000003f"),
]


def of_type(signal: Signal, **fields: object) -> Signal:
    return replace(signal, **fields)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(("name", "value", "golden"), GOLDEN)
def test_a_value_goes_out_as_the_bytes_made_by_hand(name: str, value: float, golden: str) -> None:
    assert encode(signal_named(name), value, FULL).hex() == golden


@pytest.mark.parametrize(("name", "value", "golden"), GOLDEN)
def test_the_bytes_made_by_hand_come_back_as_the_value(name: str, value: float, golden: str) -> None:
    assert decode(signal_named(name), bytes.fromhex(golden), FULL) == pytest.approx(value, rel=1e-12)


def test_every_signal_but_the_switches_has_golden_bytes_of_its_type() -> None:
    assert {signal_named(name).type for name, _, _ in GOLDEN} == {signal.type for signal in SIGNALS}


@pytest.mark.parametrize("text", ["0.9664", "0.00424", "0.00621", "0.12", "1250", "1e-06", "123.4567"])
def test_a_written_decimal_is_read_back_as_the_same_decimal(text: str) -> None:
    signal = signal_named("i_d_ref")
    assert decode(signal, encode(signal, float(text), FULL), FULL) == float(text)


@given(signal=st.sampled_from(COUNTED), fraction=st.floats(0.0, 1.0))
def test_any_value_in_range_survives_the_wire_within_half_a_count(signal: Signal, fraction: float) -> None:
    low, high = (end * count_size(signal, FULL) for end in ends(signal))
    low = low if signal.minimum is None else max(low, signal.minimum)
    high = high if signal.maximum is None else min(high, signal.maximum)
    value = min(low + fraction * (high - low), high)
    back = decode(signal, encode(signal, value, FULL), FULL)
    assert abs(back - value) <= 0.5 * count_size(signal, FULL) * (1.0 + 1e-9)


@given(value=st.floats(width=32, allow_nan=False, allow_infinity=False))
def test_any_32_bit_float_survives_the_wire_unchanged(value: float) -> None:
    signal = signal_named("i_d_ref")
    data = encode(signal, value, FULL)
    assert encode(signal, decode(signal, data, FULL), FULL) == data
    assert decode(signal, data, FULL) == pytest.approx(value, rel=1e-7)


@given(signal=st.sampled_from(SIGNALS), data=st.data())
def test_any_bytes_of_the_right_length_give_a_number_or_a_sentence(signal: Signal, data: st.DataObject) -> None:
    size = signal.type.bits // 8
    raw = data.draw(st.binary(min_size=size, max_size=size))
    try:
        known = math.isfinite(decode(signal, raw, FULL))
        assert known == (signal.full_scale is None or raw != b"\x00\x80")
    except ValueError as error:
        assert signal.type is WireType.F32
        assert "expected a finite number" in str(error)


@given(signal=st.sampled_from(SIGNALS), data=st.binary(max_size=12))
def test_bytes_of_the_wrong_length_are_refused(signal: Signal, data: bytes) -> None:
    size = signal.type.bits // 8
    if len(data) != size:
        with pytest.raises(ValueError, match=rf"\({signal.name}\) has {size} bytes, got {len(data)}"):
            decode(signal, data, FULL)


@pytest.mark.parametrize("signal", SIGNALS, ids=lambda s: s.name)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_does_not_go_out(signal: Signal, value: float) -> None:
    if signal.full_scale and math.isnan(value):
        assert encode(signal, value, FULL) == b"\x00\x80"  # a quantity that the drive does not know
        return
    with pytest.raises(ValueError, match=rf"\({signal.name}\) takes a finite number, got"):
        encode(signal, value, FULL)


@pytest.mark.parametrize("data", ["0000c07f", "0000807f", "000080ff"])
def test_what_is_no_number_does_not_come_in(data: str) -> None:
    with pytest.raises(ValueError, match=r"0x2010:1 \(i_full\) is (nan|inf|-inf), expected a finite number"):
        decode(signal_named("i_full"), bytes.fromhex(data), FULL)


@pytest.mark.parametrize("signal", WRITABLE, ids=lambda s: s.name)
def test_a_value_just_outside_a_bound_is_refused_and_the_bound_itself_taken(signal: Signal) -> None:
    for bound, outside in ((signal.minimum, -math.inf), (signal.maximum, math.inf)):
        if bound is None:
            continue
        check_range(signal, decode(signal, encode(signal, bound, FULL), FULL))
        told = f"{bound}" if signal.unit == "1" else f"{bound} {signal.unit}"
        with pytest.raises(ValueError, match=rf"\({signal.name}\) takes at (least|most) {re.escape(told)}, got"):
            encode(signal, math.nextafter(bound, outside), FULL)


@given(value=st.floats(allow_nan=False, allow_infinity=False))
def test_a_setting_is_encoded_within_its_bounds_or_refused_in_a_sentence(value: float) -> None:
    for signal in WRITABLE:
        try:
            back = decode(signal, encode(signal, value, FULL), FULL)
        except ValueError as error:
            assert str(signal) in str(error)
        else:
            check_range(signal, value)
            assert back == pytest.approx(value, rel=1e-6, abs=1e-38 if signal.type is WireType.F32 else 0.5)


def test_a_setting_without_bounds_is_still_bound_by_its_type() -> None:
    counted = of_type(signal_named("n_p"), minimum=None, maximum=None)
    with pytest.raises(ValueError, match=r"\(n_p\) takes 0 to 65535, got 65536"):
        encode(counted, 65536.0, FULL)
    with pytest.raises(ValueError, match=r"\(n_p\) takes 0 to 65535, got -1"):
        encode(counted, -1.0, FULL)
    with pytest.raises(ValueError, match=r"\(i_d_ref\) takes a 32-bit float, up to 3.4028e\+38 in size, got 1e\+39"):
        encode(signal_named("i_d_ref"), 1e39, FULL)


@given(
    signal=st.sampled_from([s for s in COUNTED if s.access != "rw"]),
    value=st.floats(allow_nan=False, allow_infinity=False),
)
def test_a_measured_value_clips_at_the_ends_as_a_converter_does(signal: Signal, value: float) -> None:
    low, high = ends(signal)
    back = decode(signal, encode(signal, value, FULL), FULL)
    clipped = min(max(value / count_size(signal, FULL), low), high) * count_size(signal, FULL)
    assert back == pytest.approx(clipped, rel=1e-9, abs=0.5001 * count_size(signal, FULL))


@pytest.mark.parametrize(("value", "golden"), [(24.0, "ff7f"), (1e300, "ff7f"), (-24.1, "0180"), (-1e308, "0180")])
def test_a_current_beyond_full_scale_goes_out_as_the_last_count(value: float, golden: str) -> None:
    assert encode(signal_named("i_d"), value, FULL).hex() == golden


def test_what_the_drive_does_not_know_comes_back_as_no_number() -> None:
    for name in ("u_d", "i_q_mean", "omega_e"):
        assert math.isnan(decode(signal_named(name), b"\x00\x80", FULL))
    assert decode(signal_named("theta_e"), b"\x00\x80", FULL) == pytest.approx(math.pi)  # an angle is always known
    assert decode(signal_named("temp_winding"), b"\x00\x80", FULL) == -327.68


NAMES = ("theta_e", "i_d", "u_q", "i_a", "omega_e")


def test_rows_of_counts_become_columns_in_si_as_by_hand() -> None:
    counts = np.array([[0x4000, 16384, -8192, -1, -32768], [-16384, -32768, 32767, 0, 16384]], np.int16)
    theta_e, i_d, u_q, i_a, omega_e = counts_to_si(counts, NAMES, FULL)
    assert theta_e == pytest.approx([math.pi / 2.0, 1.5 * math.pi])
    assert i_d == pytest.approx([12.0, math.nan], nan_ok=True)
    assert u_q == pytest.approx([-100.0, 400.0 * 32767 / 32768])
    assert i_a == pytest.approx([-24.0 / 32768, 0.0])
    assert omega_e == pytest.approx([math.nan, 1500.0], nan_ok=True)


@given(st.lists(st.tuples(*[st.integers(-32768, 32767)] * len(NAMES)), min_size=1, max_size=20))
def test_any_counts_survive_the_way_to_si_and_back(rows: list[tuple[int, ...]]) -> None:
    counts = np.array(rows, np.int16)
    assert np.array_equal(si_to_counts(list(counts_to_si(counts, NAMES, FULL)), NAMES, FULL), counts)


@given(name=st.sampled_from(CHANNELS[1:]), value=st.floats(-500.0, 500.0))
def test_a_column_goes_out_as_the_same_bytes_as_a_single_value(name: str, value: float) -> None:
    value = abs(value) % 6.283 if name == "theta_e" else value
    column = np.array([value])
    assert si_to_counts([column], [name], FULL).tobytes() == encode(channel_signal(name), value, FULL)


def test_a_channel_that_no_recorder_has_is_told_with_those_there_are() -> None:
    assert [channel_number(name) for name in ("theta_e", "i_c")] == [1, 10]
    with pytest.raises(ValueError, match=r"expected a channel out of theta_e, i_d, .*, i_c, got 'torque'"):
        channel_number("torque")
    with pytest.raises(ValueError, match="got 'none'"):
        channel_number("none")


def test_no_type_of_the_wire_is_wider_than_four_bytes_or_of_another_name_in_cia_301() -> None:
    assert {kind.name: kind.canopen_type for kind in WireType} == {
        "U8": 5, "U16": 6, "U32": 7, "I16": 3, "I32": 4, "F32": 8,
    }
    assert all(kind.bits in (8, 16, 32) and kind.struct_format[0] == "<" for kind in WireType)
