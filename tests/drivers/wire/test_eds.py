"""The data sheet by the rules of CiA 306 version 1.3: checked as a checker of data sheets does, rule by rule."""

import re
from collections.abc import Generator, Mapping
from configparser import RawConfigParser

import pytest

from drivers.wire.canopen_od import eds

VARIABLE, ARRAY, RECORD, DOMAIN = 0x7, 0x8, 0x9, 0x2  # object codes (CiA 301, table 42)
BITS = {1: 1, 2: 8, 3: 16, 4: 32, 5: 8, 6: 16, 7: 32, 8: 32, 9: 0, 0xA: 0, 0xB: 0, 0xF: 0}  # by data type (table 44)
SIGNED = (2, 3, 4)
RATES = (10, 20, 50, 125, 250, 500, 800, 1000)  # kbit/s
TIME, DATE = r"(0[1-9]|1[0-2]):[0-5]\d[AP]M", r"(0[1-9]|1[0-2])-(0[1-9]|[12]\d|3[01])-\d{4}"
FILE = {  # 4.4, file information
    "FileName": r".{1,246}", "FileVersion": r"\d+", "FileRevision": r"\d+", "EDSVersion": r"4\.0",
    "Description": r".{0,243}", "CreationTime": TIME, "CreationDate": DATE, "CreatedBy": r".{0,245}",
    "ModificationTime": TIME, "ModificationDate": DATE, "ModifiedBy": r".{0,244}",
}
DEVICE = {  # 4.5, general device information
    "VendorName": r".{0,244}", "ProductName": r".{0,243}", "OrderCode": r".{0,245}",
    **dict.fromkeys(("VendorNumber", "ProductNumber", "RevisionNumber"), "0x[0-9A-F]{1,8}"),
    **dict.fromkeys((
        *(f"BaudRate_{rate}" for rate in RATES), "SimpleBootUpMaster", "SimpleBootUpSlave", "GroupMessaging",
        "LSS_Supported", "DynamicChannelsSupported",
    ), "[01]"),
    "Granularity": r"[0-9]|[1-5]\d|6[0-4]", "NrOfRXPDO": r"\d{1,3}", "NrOfTXPDO": r"\d{1,3}",
}
LISTS = {  # 4.6.1: the part of the dictionary that each may name
    "MandatoryObjects": {0x1000, 0x1001, 0x1018},
    "OptionalObjects": {*range(0x1000, 0x2000), *range(0x6000, 0x10000)},
    "ManufacturerObjects": {*range(0x2000, 0x6000)},
}
SINGLE = {"ParameterName", "ObjectType", "DataType", "AccessType", "DefaultValue", "PDOMapping"}
COMPOSED = {"ParameterName", "ObjectType", "SubNumber"}
KEYS = {VARIABLE: SINGLE, DOMAIN: SINGLE, ARRAY: COMPOSED, RECORD: COMPOSED}  # 4.6.3: that an object has, by its code
STANDARD = {  # object codes that CiA 301, 7.5.2, and CiA 402-2 give
    0x1003: ARRAY, 0x1010: ARRAY, 0x1011: ARRAY, 0x1016: ARRAY, 0x1018: RECORD,
    **dict.fromkeys((0x1000, 0x1001, 0x1005, 0x1008, 0x1014, 0x1017, 0x603F, 0x6040, 0x6041), VARIABLE),
    **dict.fromkeys((*range(0x1800, 0x1A00), *range(0x1A00, 0x1C00)), RECORD),
}

Sections = Mapping[str, Mapping[str, str]]


def violations(text: str) -> list[str]:
    """Each rule that a data sheet breaks, in words."""
    parser = RawConfigParser(strict=True)
    parser.optionxform = str  # pyright: ignore[reportAttributeAccessIssue]
    parser.read_string(text)
    sheet = {name: dict(parser[name]) for name in parser.sections()}
    found = [f"{len(line)} characters in a line" for line in text.splitlines() if len(line) > 255]  # 4.2
    for part in (_head(sheet), _lists(sheet), _objects(sheet), _pdos(sheet)):
        found += part
    return found


def _head(sheet: Sections) -> Generator[str]:
    for section, rules in (("FileInfo", FILE), ("DeviceInfo", DEVICE)):
        for key in rules.keys() ^ sheet[section].keys():
            yield f"[{section}] {key} is missing, or unknown"
        for key, rule in rules.items():
            if not re.fullmatch(rule, sheet[section].get(key, "")):
                yield f"[{section}] {key} is {sheet[section].get(key)}"
    if not any(sheet["DeviceInfo"].get(f"BaudRate_{rate}") == "1" for rate in RATES):
        yield "no baud rate"
    for key, subindex in (("VendorNumber", 1), ("ProductNumber", 2), ("RevisionNumber", 3)):
        if int(sheet["DeviceInfo"][key], 16) != int(sheet[f"1018sub{subindex}"]["DefaultValue"], 16):
            yield f"{key} is not that of object 0x1018"
    if sheet["DummyUsage"].keys() - {f"Dummy{k:04X}" for k in range(1, 8)}:  # 4.6.2
        yield "unknown dummies"
    if int(sheet["Comments"]["Lines"]) != len(sheet["Comments"]) - 1:  # 4.7
        yield "another number of comment lines"


def _lists(sheet: Sections) -> Generator[str]:
    listed = list[int]()
    for section, allowed in LISTS.items():
        entries = {key: value for key, value in sheet[section].items() if key != "SupportedObjects"}
        numbers = [str(k) for k in range(1, len(entries) + 1)]
        if sheet[section]["SupportedObjects"] != str(len(entries)) or list(entries) != numbers:
            yield f"[{section}] does not count its objects"
        indices = [int(value, 16) for value in entries.values()]
        yield from (f"0x{index:04X} is none of [{section}]" for index in indices if index not in allowed)
        listed += indices
    there = [int(name, 16) for name in sheet if re.fullmatch("[0-9A-F]{4}", name)]
    if sorted(listed) != sorted(there):
        yield "objects listed are not those described"
    if not {0x1000, 0x1001, 0x1018} <= set(listed):
        yield "a mandatory object is missing"


def _objects(sheet: Sections) -> Generator[str]:
    for name, entry in sheet.items():
        if not (match := re.fullmatch("([0-9A-F]{4})(sub[0-9A-F]+)?", name)):
            continue
        kind = int(entry.get("ObjectType", "7"), 0)
        if kind not in KEYS or not KEYS[kind] <= entry.keys() <= KEYS[kind] | {"LowLimit", "HighLimit"}:
            yield f"[{name}] has the keys {', '.join(entry)}"
            continue
        if not 1 <= len(entry["ParameterName"]) <= 241:
            yield f"[{name}] ParameterName"
        if not match[2] and STANDARD.get(int(name, 16), kind) != kind:
            yield f"[{name}] is of another object code in the standard"
        if kind in (ARRAY, RECORD):
            yield from _composed(sheet, name)
        else:
            yield from _single(name, entry, kind)


def _composed(sheet: Sections, name: str) -> Generator[str]:
    subs = [int(other[7:], 16) for other in sheet if other.startswith(f"{name}sub")]
    if int(sheet[name]["SubNumber"], 0) != len(subs) or 0 not in subs:
        yield f"[{name}] SubNumber"
    head = sheet[f"{name}sub0"]
    if int(head["DataType"], 0) != 5 or head["AccessType"] not in ("const", "ro", "rw"):
        yield f"[{name}sub0] is no count"
    if head["AccessType"] == "const" and int(head["DefaultValue"], 0) != max(subs):
        yield f"[{name}sub0] is not the highest sub-index"
    types = {sheet[f"{name}sub{k:X}"]["DataType"] for k in subs if k}
    if int(sheet[name]["ObjectType"], 0) == ARRAY and len(types) > 1:
        yield f"[{name}] is an array of several types"


def _single(name: str, entry: Mapping[str, str], kind: int) -> Generator[str]:
    type_, default = int(entry["DataType"], 0), entry["DefaultValue"]
    if type_ not in BITS or (kind == DOMAIN) != (type_ == 0xF):
        yield f"[{name}] DataType"
    elif not re.fullmatch(r"|(\$NODEID\+)?0x[0-9A-F]+", default) and type_ != 9:
        yield f"[{name}] DefaultValue"
    elif BITS[type_] and default and int(default.removeprefix("$NODEID+"), 16) >> BITS[type_]:
        yield f"[{name}] DefaultValue does not fit its type"
    if entry["AccessType"] not in ("ro", "wo", "rw", "rwr", "rww", "const"):
        yield f"[{name}] AccessType"
    if entry["PDOMapping"] not in ("0", "1") or (entry["PDOMapping"] == "1" and not BITS.get(type_)):
        yield f"[{name}] PDOMapping"
    low, high = (_number(entry[key], type_) if key in entry else None for key in ("LowLimit", "HighLimit"))
    if low is not None and high is not None and low > high:
        yield f"[{name}] LowLimit is above HighLimit"


def _number(text: str, type_: int) -> int:
    """A limit; that of a signed type as its two's complement."""
    value, bits = int(text, 16), BITS[type_]
    return value - (1 << bits) if type_ in SIGNED and value >> bits - 1 else value


def _pdos(sheet: Sections) -> Generator[str]:
    info, granularity = sheet["DeviceInfo"], int(sheet["DeviceInfo"]["Granularity"])
    for key, base in (("NrOfRXPDO", 0x1400), ("NrOfTXPDO", 0x1800)):
        numbers = [k for k in range(512) if f"{base + k:04X}" in sheet]
        if int(info[key]) != len(numbers):
            yield f"{key} is {info[key]}, there are {len(numbers)}"
        for mapping in (f"{base + 0x200 + k:04X}" for k in numbers):
            changeable = sheet[f"{mapping}sub0"]["AccessType"] == "rw"
            if changeable != bool(granularity):  # 4.5: 0 where the mapping cannot be changed
                yield f"Granularity is {granularity}, but [{mapping}] can{'' if changeable else 'not'} be changed"
            count = int(sheet[f"{mapping}sub0"]["DefaultValue"], 16)
            entries = [int(sheet[f"{mapping}sub{k:X}"]["DefaultValue"], 16) for k in range(1, count + 1)]
            if sum(entry & 0xFF for entry in entries) > 64:
                yield f"[{mapping}] is longer than 8 bytes"
            yield from (f"[{mapping}] maps 0x{entry:08X}" for entry in entries if not _mappable(sheet, entry))


def _mappable(sheet: Sections, entry: int) -> bool:
    index, subindex, bits = entry >> 16, entry >> 8 & 0xFF, entry & 0xFF
    found = sheet.get(f"{index:04X}sub{subindex:X}") or sheet.get(f"{index:04X}", {})
    return found.get("PDOMapping") == "1" and BITS[int(found["DataType"], 0)] == bits


def test_the_data_sheet_keeps_to_the_standard() -> None:
    assert violations(eds()) == []


@pytest.mark.parametrize(
    ("right", "wrong", "told"),
    [
        ("Granularity=8", "Granularity=0", "Granularity is 0, but [1A00] can be changed"),
        ("NrOfTXPDO=4", "NrOfTXPDO=3", "NrOfTXPDO is 3, there are 4"),
        ("SupportedObjects=3", "SupportedObjects=2", "[MandatoryObjects] does not count its objects"),
        ("1=0x2000", "1=0x6000", "0x6000 is none of [ManufacturerObjects]"),
        ("EDSVersion=4.0\n", "", "[FileInfo] EDSVersion is missing, or unknown"),
        ("CreationTime=12:00PM", "CreationTime=12:00", "[FileInfo] CreationTime is 12:00"),
        ("BaudRate_1000=1", "BaudRate_1000=0", "no baud rate"),
        ("LSS_Supported=0", "LSS_Supported=no", "[DeviceInfo] LSS_Supported is no"),
        ("ProductNumber=0x504D534D", "ProductNumber=0x1", "ProductNumber is not that of object 0x1018"),
        ("[1018]\nParameterName=Identity\nObjectType=0x9\nSubNumber=5",
         "[1018]\nParameterName=Identity\nObjectType=0x9\nSubNumber=4", "[1018] SubNumber"),
        ("Store parameters\nObjectType=0x8", "Store parameters\nObjectType=0x9",
         "[1010] is of another object code in the standard"),
        ("Error register\nObjectType=0x7\nDataType=0x0005\nAccessType=ro",
         "Error register\nObjectType=0x7\nDataType=0x0005\nAccessType=R", "[1001] AccessType"),
        ("DefaultValue=0x21000110", "DefaultValue=0x21000108", "[1A00] maps 0x21000108"),
        ("ObjectType=0x2\n", "ObjectType=0x7\n", "[2410sub1] DataType"),
    ],
)
def test_the_checker_tells_what_is_wrong(right: str, wrong: str, told: str) -> None:
    assert right in eds()
    assert told in violations(eds().replace(right, wrong, 1))
