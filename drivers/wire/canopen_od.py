"""CANopen's view of the dictionary: identifiers, PDO layouts, the EDS. Derived, never written a second time.

Standards: CiA 301 (application layer), CiA 306 (electronic data sheet). Pure: bytes and text.
"""

import struct
from collections.abc import Iterable
from enum import IntEnum
from typing import Final

from drivers.wire.dictionary import CAPTURE_DATA, CONTROL, SIGNALS, TABLES, Signal, WireType, signal_at, signal_named

DEVICE_NAME: Final = "pmsm-bench virtual drive"
DEVICE_TYPE: Final = 0x0002_0192  # CiA 402, servo drive
VENDOR_ID: Final = 0  # none assigned
PRODUCT_CODE: Final = 0x504D_534D  # "PMSM"
REVISION: Final = 1

# Communication objects (CiA 301)
OD_DEVICE_TYPE: Final = 0x1000
OD_ERROR_REGISTER: Final = 0x1001
OD_ERROR_HISTORY: Final = 0x1003
OD_SYNC_COB_ID: Final = 0x1005
OD_DEVICE_NAME: Final = 0x1008
OD_STORE: Final = 0x1010
OD_RESTORE: Final = 0x1011
OD_EMERGENCY_COB_ID: Final = 0x1014
OD_HEARTBEAT_CONSUMER: Final = 0x1016
OD_HEARTBEAT: Final = 0x1017
OD_IDENTITY: Final = 0x1018
OD_TPDO: Final = 0x1800
OD_TPDO_MAPPING: Final = 0x1A00

# NMT (CiA 301, 7.2.8): command specifiers and states
NMT_COB_ID: Final = 0x000
NMT_START: Final = 1
NMT_STOP: Final = 2
NMT_PRE_OPERATIONAL: Final = 128
NMT_RESET_NODE: Final = 129
NMT_RESET_COMMUNICATION: Final = 130
STATE_BOOT_UP: Final = 0
STATE_STOPPED: Final = 4
STATE_OPERATIONAL: Final = 5
STATE_PRE_OPERATIONAL: Final = 127


class Abort(IntEnum):
    """SDO abort codes (CiA 301, table 22)."""

    TOGGLE = 0x05030000
    TIME_OUT = 0x05040000
    COMMAND = 0x05040001
    BLOCK_SIZE = 0x05040002
    SEQUENCE = 0x05040003
    CRC = 0x05040004
    MEMORY = 0x05040005
    WRITE_ONLY = 0x06010001
    READ_ONLY = 0x06010002
    NO_OBJECT = 0x06020000
    NOT_MAPPABLE = 0x06040041
    PDO_LENGTH = 0x06040042
    LENGTH = 0x06070010
    NO_SUBINDEX = 0x06090011
    VALUE_RANGE = 0x06090030
    GENERAL = 0x08000000
    NOT_STORED = 0x08000020
    DEVICE_STATE = 0x08000022
    NO_DATA = 0x08000024


# SDO answers (CiA 301, 7.2.4.3): byte 0
DOWNLOADED: Final = 0x60  # an object has been written
UPLOADED_4: Final = 0x43  # an object of 4 bytes

SYNC_COB_ID: Final = 0x080
HEARTBEAT_MS: Final = 100  # ms, default producer time
RECOVERED_FROM_BUS_OFF: Final = 0x8140  # error code (CiA 301)
ERROR_HISTORY: Final = 8  # errors at most in object 0x1003
BENCH_NODE: Final = 127  # the node whose heartbeat the bench sends; another where the drive itself has this id
STORES_ON_COMMAND: Final = 1  # what objects 0x1010 and 0x1011 tell when they are read
BUS_FRAMES: Final = 8000  # full frames a second on a bus of 1 Mbit/s
SLOW_ROWS: Final = 100  # the slow TPDO goes with every this many rows
UPLOAD_SAMPLES: Final = 4096  # of a recording, at most, that one transfer of object 0x2410 brings: 0.9 s at 1 Mbit/s

TPDO_LAYOUT: Final[tuple[tuple[Signal, ...], ...]] = tuple(
    tuple(signal_named(name) for name in names)
    for names in (
        ("row_tick", "theta_e", "i_d", "i_q"),
        ("row_tick", "omega_e", "u_d", "u_q"),
        ("row_tick", "u_dc", "i_d_mean", "i_q_mean"),
        ("row_tick", "temp_winding", "temp_magnet"),  # slow
    )
)
ROW_TPDOS: Final = 3  # so many frames make a row


def tpdo_cob_id(number: int, node_id: int) -> int:
    """Identifier of TPDO `number` (0 to 3), predefined connection set."""
    return 0x180 + 0x100 * number + node_id


def emergency_cob_id(node_id: int) -> int:
    """Identifier of the node's emergency messages."""
    return 0x080 + node_id


def sdo_request_cob_id(node_id: int) -> int:
    """Identifier of the client's SDO requests."""
    return 0x600 + node_id


def sdo_response_cob_id(node_id: int) -> int:
    """Identifier of the server's SDO answers."""
    return 0x580 + node_id


def sdo_address(index: int, subindex: int) -> bytes:
    """Bytes 1 to 3 of an SDO frame: the object that it is about."""
    return struct.pack("<HB", index, subindex)


def sdo_downloaded(index: int, subindex: int) -> bytes:
    """Bytes 0 to 3 of the server's answer when an object has been written."""
    return bytes([DOWNLOADED]) + sdo_address(index, subindex)


def uploaded_size(head: int) -> int:
    """Bytes of the object that the server's answer holds, by its byte 0; 0 where it holds none, or not all of it."""
    return 4 - (head >> 2 & 3) if head & 0xE3 == 0x43 else 0


def heartbeat_cob_id(node_id: int) -> int:
    """Identifier of boot-up and heartbeat."""
    return 0x700 + node_id


def tpdo_struct_format(number: int) -> str:
    """Format of TPDO `number` for the struct module."""
    return "<" + "".join(signal.type.struct_format[1:] for signal in TPDO_LAYOUT[number])


def tpdo_mapping(number: int) -> tuple[int, ...]:
    """Mapping entries (index, subindex, bits packed as CiA 301 has it) of TPDO `number`."""
    return tuple(s.index << 16 | s.subindex << 8 | s.type.bits for s in TPDO_LAYOUT[number])


NOT_VALID: Final = 1 << 31  # bit of a TPDO's COB-ID: it is not sent
ON_EVENT: Final = 254  # transmission type: when the drive has something to tell, here with its rows
MAPPING_ENTRIES: Final = 8  # at most, in a TPDO


def transmission_known(type_: int) -> bool:
    """Whether the drive knows this transmission type: every 1st to 240th SYNC, or on events of its own."""
    return 1 <= type_ <= 240 or type_ in (254, 255)


def mappable(signal: Signal) -> bool:
    """Whether a TPDO may carry this signal."""
    return signal.index == 0x2100 or signal.name in ("status_word", "error_code", "tick")


def mapping_text(entries: Iterable[int]) -> str:
    """A mapping in words."""
    def name(entry: int) -> str:
        signal = signal_at(entry >> 16, entry >> 8 & 0xFF)
        return signal.name if signal and signal.type.bits == entry & 0xFF else f"0x{entry:08X}"

    return " ".join(map(name, entries)) or "nothing"


_AT, _ON = "12:00PM", "11-21-2026"  # of the data sheet; by no clock, so that it is the same every time


def eds() -> str:
    """The drive's electronic data sheet (CiA 306) as text."""
    objects: dict[int, list[str]] = {
        OD_DEVICE_TYPE: _variable(OD_DEVICE_TYPE, None, "Device type", 0x07, "ro", DEVICE_TYPE),
        OD_ERROR_REGISTER: _variable(OD_ERROR_REGISTER, None, "Error register", 0x05, "ro", 0),
        OD_DEVICE_NAME: _variable(OD_DEVICE_NAME, None, "Device name", 0x09, "const", DEVICE_NAME),
        OD_ERROR_HISTORY: _array(OD_ERROR_HISTORY, "Pre-defined error field", "rw", 0, [
            (f"Error {k}", 0x07, "ro", None) for k in range(1, ERROR_HISTORY + 1)]),
        OD_SYNC_COB_ID: _variable(OD_SYNC_COB_ID, None, "COB-ID SYNC message", 0x07, "const", SYNC_COB_ID),
        OD_EMERGENCY_COB_ID: _variable(OD_EMERGENCY_COB_ID, None, "COB-ID EMCY", 0x07, "ro", "$NODEID+0x80"),
        OD_HEARTBEAT_CONSUMER: _array(OD_HEARTBEAT_CONSUMER, "Consumer heartbeat time", "const", 1, [
            ("Bench", 0x07, "rw", 0)]),
        OD_HEARTBEAT: _variable(OD_HEARTBEAT, None, "Producer heartbeat time", 0x06, "rw", HEARTBEAT_MS),
        OD_IDENTITY: _record(OD_IDENTITY, "Identity", [
            ("Vendor-ID", 0x07, "ro", VENDOR_ID), ("Product code", 0x07, "ro", PRODUCT_CODE),
            ("Revision number", 0x07, "ro", REVISION), ("Serial number", 0x07, "ro", None)]),
    }
    for number in range(len(TPDO_LAYOUT)):
        objects[OD_TPDO + number] = _record(OD_TPDO + number, f"TPDO {number + 1}", [
            ("COB-ID", 0x07, "rw", f"$NODEID+0x{tpdo_cob_id(number, 0):X}"),
            ("Transmission type", 0x05, "rw", ON_EVENT)])
        mapping = tpdo_mapping(number)
        entries = (*mapping, *[0] * (MAPPING_ENTRIES - len(mapping)))
        objects[OD_TPDO_MAPPING + number] = _array(OD_TPDO_MAPPING + number, f"TPDO {number + 1} mapping", "rw", len(
            mapping), [(f"Entry {k}", 0x07, "rw", entry) for k, entry in enumerate(entries, 1)], record=True)
    for index in sorted({signal.index for signal in SIGNALS}):
        objects[index] = _signals(index, [signal for signal in SIGNALS if signal.index == index])
    objects[CAPTURE_DATA[0]] = _record(CAPTURE_DATA[0], "Recording", [("Data", _DOMAIN_TYPE, "ro", None)])
    objects[CONTROL[0]] = _variable(CONTROL[0], None, "Control record", _DOMAIN_TYPE, "wo", None)

    mandatory = [OD_DEVICE_TYPE, OD_ERROR_REGISTER, OD_IDENTITY]
    own = [index for index in objects if 0x2000 <= index < 0x6000]
    optional = [index for index in objects if index not in (*mandatory, *own)]
    head = [
        "[FileInfo]", "FileName=pmsm-bench.eds", "FileVersion=1", "FileRevision=0", "EDSVersion=4.0",
        "Description=Permanent-magnet synchronous motor drive",
        *(line for done in ("Creation", "Modification") for line in (f"{done}Time={_AT}", f"{done}Date={_ON}")),
        "CreatedBy=pmsm-bench", "ModifiedBy=pmsm-bench", "",
        "[DeviceInfo]", "VendorName=pmsm-bench", f"VendorNumber=0x{VENDOR_ID:08X}", f"ProductName={DEVICE_NAME}",
        f"ProductNumber=0x{PRODUCT_CODE:08X}", f"RevisionNumber=0x{REVISION:08X}", "OrderCode=0",
        *(f"BaudRate_{rate}={int(rate == 1000)}" for rate in (10, 20, 50, 125, 250, 500, 800, 1000)),
        "SimpleBootUpMaster=0", "SimpleBootUpSlave=1", "Granularity=8", "DynamicChannelsSupported=0",
        "GroupMessaging=0",
        "NrOfRXPDO=0", f"NrOfTXPDO={len(TPDO_LAYOUT)}", "LSS_Supported=0", "",
        "[DummyUsage]", *(f"Dummy000{k}=0" for k in range(1, 8)), "",
        "[Comments]", "Lines=0", "",
    ]
    lists = [line for title, group in (("MandatoryObjects", mandatory), ("OptionalObjects", optional),
                                       ("ManufacturerObjects", own))
             for line in (f"[{title}]", f"SupportedObjects={len(group)}",
                          *(f"{k}=0x{index:04X}" for k, index in enumerate(sorted(group), 1)), "")]
    return "\n".join([*head, *lists, *(line for index in sorted(objects) for line in objects[index])])


_DOMAIN, _VARIABLE, _ARRAY, _RECORD = 0x2, 0x7, 0x8, 0x9  # object codes (CiA 301, table 42)
_DOMAIN_TYPE: Final = 0x0F
Entry = tuple[str, int, str, int | str | None]


def _variable(
    index: int, subindex: int | None, name: str, canopen_type: int, access: str, default: int | str | None,
    mapped: bool = False, limits: Iterable[str] = (),
) -> list[str]:
    kind = _DOMAIN if canopen_type == _DOMAIN_TYPE else _VARIABLE
    section = f"{index:04X}" if subindex is None else f"{index:04X}sub{subindex:X}"
    value = f"0x{default:X}" if isinstance(default, int) else default or ""
    return [
        f"[{section}]", f"ParameterName={name}", f"ObjectType=0x{kind}", f"DataType=0x{canopen_type:04X}",
        *limits, f"AccessType={access}", f"DefaultValue={value}", f"PDOMapping={int(mapped)}", "",
    ]


def _record(index: int, name: str, entries: list[Entry]) -> list[str]:
    return _array(index, name, "const", len(entries), entries, record=True)


def _array(
    index: int, name: str, head_access: str, count: int, entries: list[Entry], record: bool = False
) -> list[str]:
    """`head_access` and `count` are those of sub-index 0."""
    kind = _RECORD if record else _ARRAY
    lines = [f"[{index:04X}]", f"ParameterName={name}", f"ObjectType=0x{kind}", f"SubNumber={len(entries) + 1}", ""]
    lines += _variable(index, 0, "Highest sub-index supported", 0x05, head_access, count)
    for k, (entry, canopen_type, access, default) in enumerate(entries, 1):
        lines += _variable(index, k, entry, canopen_type, access, default)
    return lines


_NAMES: Final = {
    0x1010: "Store parameters", 0x1011: "Restore default parameters", 0x2000: "Drive", 0x2010: "Full scales",
    0x2100: "Stream", 0x2200: "Control", 0x2300: "References", 0x2310: "Protections",
    0x2320: "Safety", 0x2400: "Recorder", 0x2500: "Control lease",
    0x2210: "Current control", 0x2220: "Speed control", 0x2230: "Sensing", 0x2240: "Inverter", 0x2250: "Saturation",
    0x2260: "Encoder", 0x2510: "Memory", **{index: name for name, (index, _, _) in TABLES.items()},
}


def _signals(index: int, signals: list[Signal]) -> list[str]:
    if signals[0].subindex == 0:
        (s,) = signals
        return _variable(index, None, s.name, s.type.canopen_type, s.access, None, mappable(s))
    name = _NAMES[index]
    highest = max(signal.subindex for signal in signals)
    kind = _ARRAY if index in (OD_STORE, OD_RESTORE) else _RECORD
    lines = [f"[{index:04X}]", f"ParameterName={name}", f"ObjectType=0x{kind}", f"SubNumber={len(signals) + 1}", ""]
    lines += _variable(index, 0, "Highest sub-index supported", WireType.U8.canopen_type, "const", highest)
    for s in signals:
        lines += _variable(s.index, s.subindex, s.name, s.type.canopen_type, s.access, None, mappable(s), _limits(s))
    return lines


def _limits(signal: Signal) -> list[str]:
    """The range of a whole number; that of others has no form that all tools read."""
    if signal.type is WireType.F32 or not signal.is_parameter:
        return []
    bounds = (("LowLimit", signal.minimum), ("HighLimit", signal.maximum))
    mask = (1 << signal.type.bits) - 1
    return [f"{key}=0x{int(value) & mask:X}" for key, value in bounds if value is not None]
