"""An A2L fragment (ASAM MCD-2 MC 1.6) of a parameter set's signals: CHARACTERISTIC, COMPU_METHOD and RECORD_LAYOUT.

Addresses are those of the signals on CANopen, index times 256 plus sub-index: whoever calibrates by XCP puts the linker
map's in their place. The set's values stand in annotations.
"""

from typing import Final

from bench.parameters.parameter_set import FLASHED, ParameterSet
from drivers.wire.dictionary import TABLE_SIZE, TABLES, Signal, WireType

_BY_NAME: Final = {signal.name: signal for signal in FLASHED}
_TYPES: Final = {
    WireType.F32: "FLOAT32_IEEE", WireType.U8: "UBYTE", WireType.U16: "UWORD", WireType.I16: "SWORD",
    WireType.U32: "ULONG", WireType.I32: "SLONG",
}
_RANGE: Final = {
    WireType.F32: (-3.4e38, 3.4e38), WireType.U8: (0, 255), WireType.U16: (0, 65535), WireType.I16: (-32768, 32767),
    WireType.U32: (0, 4294967295), WireType.I32: (-2147483648, 2147483647),
}


def as_a2l(given: ParameterSet) -> str:
    """The fragment."""
    signals = [_BY_NAME[name] for name in given.entries if not _BY_NAME[name].table]
    tables = [table for table in TABLES if f"{table}_1" in given.entries]
    shown = [*signals, *(_BY_NAME[f"{table}_1"] for table in tables)]
    lines = list[str]()
    for unit in dict.fromkeys(signal.unit for signal in shown):
        shown_unit = "" if unit == "1" else unit
        lines += [f'/begin COMPU_METHOD {_method(unit)} "" IDENTICAL "%.9" "{shown_unit}"', "/end COMPU_METHOD"]
    for kind in dict.fromkeys(signal.type for signal in shown):
        values = f"  FNC_VALUES 1 {_TYPES[kind]} ROW_DIR DIRECT"
        lines += [f"/begin RECORD_LAYOUT {_layout(kind)}", values, "/end RECORD_LAYOUT"]
    for signal in signals:
        lines += _characteristic(signal, signal.name, "VALUE", repr(given.entries[signal.name].value))
    for table in tables:
        values = " ".join(repr(given.entries[f"{table}_{k}"].value) for k in range(1, TABLE_SIZE + 1))
        lines += _characteristic(_BY_NAME[f"{table}_1"], table, "VAL_BLK", values, f"  NUMBER {TABLE_SIZE}")
    return "\n".join([*lines, ""])


def _characteristic(signal: Signal, name: str, kind: str, value: str, *more: str) -> list[str]:
    least, most = _RANGE[signal.type]
    low = least if signal.minimum is None else signal.minimum
    high = most if signal.maximum is None else signal.maximum
    address, method = signal.index * 256 + signal.subindex, _method(signal.unit)
    return [
        f'/begin CHARACTERISTIC {name} "{signal.summary}"',
        f"  {kind} 0x{address:08X} {_layout(signal.type)} 0 {method} {low:g} {high:g}",
        *more, '  /begin ANNOTATION', '    ANNOTATION_LABEL "value"', "    /begin ANNOTATION_TEXT",
        f'      "{value}"', "    /end ANNOTATION_TEXT", "  /end ANNOTATION", "/end CHARACTERISTIC",
    ]  # fmt: skip


def _method(unit: str) -> str:
    return "CM_" + "".join(c if c.isalnum() else "_" for c in ("one" if unit == "1" else unit))


def _layout(kind: WireType) -> str:
    return f"RL_{kind.name}"
