"""CANopen's view of the dictionary: identifiers and bytes by CiA 301, the data sheet by CiA 306."""

import io
import re
import struct
from configparser import RawConfigParser
from typing import Any, cast

import canopen
import pytest
from canopen.objectdictionary import import_od

from drivers.wire import canopen_od as od
from drivers.wire.dictionary import CAPTURE_DATA, CONTROL, SIGNALS, Signal, layout_id


def sheet() -> RawConfigParser:
    """The data sheet as an INI file; a section or key that is there twice fails."""
    parser = RawConfigParser(strict=True)
    parser.optionxform = str  # pyright: ignore[reportAttributeAccessIssue]
    parser.read_string(od.eds())
    return parser


def loaded(node_id: int | None = 5) -> canopen.ObjectDictionary:
    """The data sheet as the canopen library understands it."""
    source: Any = io.StringIO(od.eds())
    source.name = "pmsm-bench.eds"
    return import_od(source, node_id)


def variable(dictionary: canopen.ObjectDictionary, index: int, subindex: int) -> Any:
    found = cast(Any, dictionary)[index]
    return found if subindex == 0 and not hasattr(found, "subindices") else found[subindex]


# Generic predefined connection set of CiA 301


@pytest.mark.parametrize(("number", "base"), [(0, 0x180), (1, 0x280), (2, 0x380), (3, 0x480)])
@pytest.mark.parametrize("node_id", [1, 5, 127])
def test_a_tpdo_has_the_identifier_of_the_predefined_connection_set(number: int, base: int, node_id: int) -> None:
    assert od.tpdo_cob_id(number, node_id) == base + node_id


def test_sdo_nmt_and_heartbeat_have_the_identifiers_of_the_predefined_connection_set() -> None:
    assert od.NMT_COB_ID == 0x000
    assert od.sdo_request_cob_id(5) == 0x605
    assert od.sdo_response_cob_id(5) == 0x585
    assert od.heartbeat_cob_id(127) == 0x77F


def test_no_two_identifiers_of_two_nodes_are_the_same() -> None:
    used = [
        cob_id
        for node in range(1, 128)
        for cob_id in (
            *(od.tpdo_cob_id(number, node) for number in range(4)),
            od.sdo_request_cob_id(node), od.sdo_response_cob_id(node), od.heartbeat_cob_id(node),
        )
    ]
    assert len(used) == len(set(used))
    assert max(used) <= 0x7FF
    assert min(used) > 0


def test_nmt_commands_and_states_are_those_of_the_standard() -> None:
    assert (od.NMT_START, od.NMT_STOP, od.NMT_PRE_OPERATIONAL) == (0x01, 0x02, 0x80)
    assert (od.NMT_RESET_NODE, od.NMT_RESET_COMMUNICATION) == (0x81, 0x82)
    assert (od.STATE_BOOT_UP, od.STATE_STOPPED, od.STATE_OPERATIONAL, od.STATE_PRE_OPERATIONAL) == (0, 4, 5, 0x7F)


# Mapping entries by hand: index << 16 | subindex << 8 | bits, as CiA 301 has object 0x1A00
MAPPING = [
    (0x2100_01_10, 0x2100_02_10, 0x2100_03_10, 0x2100_04_10),  # row_tick theta_e i_d i_q
    (0x2100_01_10, 0x2100_05_10, 0x2100_06_10, 0x2100_07_10),  # row_tick omega_e u_d u_q
    (0x2100_01_10, 0x2100_0A_10, 0x2100_08_10, 0x2100_09_10),  # row_tick u_dc i_d_mean i_q_mean
    (0x2100_01_10, 0x2100_0B_10, 0x2100_0C_10),  # row_tick temp_winding temp_magnet
]


@pytest.mark.parametrize("number", range(4))
def test_a_mapping_is_the_one_made_by_hand(number: int) -> None:
    assert od.tpdo_mapping(number) == MAPPING[number]


@pytest.mark.parametrize(
    ("number", "values", "golden"),
    [
        (0, (0x1234, 0x8000, -2, 0x4000), "34120080feff0040"),
        (1, (65535, -1, -32768, 32767), "ffffffff0080ff7f"),
        (2, (0, 24576, 256, -256), "00000060000100ff"),
        (3, (10, 2340, -4000), "0a00240960f0"),
    ],
)
def test_a_pdo_is_packed_as_by_hand(number: int, values: tuple[int, ...], golden: str) -> None:
    assert struct.pack(od.tpdo_struct_format(number), *values).hex() == golden
    assert struct.unpack(od.tpdo_struct_format(number), bytes.fromhex(golden)) == values


def test_the_library_reads_the_data_sheet() -> None:
    dictionary = loaded()
    assert {s.index for s in SIGNALS} < set(dictionary)
    info = cast(Any, dictionary).device_information
    assert info.product_name == "pmsm-bench virtual drive"
    assert info.product_number == 0x504D534D
    assert info.nr_of_TXPDO == 4
    assert info.nr_of_RXPDO == 0
    assert info.allowed_baudrates == {1_000_000}


@pytest.mark.parametrize("signal", SIGNALS, ids=lambda s: s.name)
def test_every_signal_stands_in_the_data_sheet_with_its_type_and_access(signal: Signal) -> None:
    found = variable(loaded(), signal.index, signal.subindex)
    assert found.name == signal.name
    assert found.data_type == signal.type.canopen_type
    assert found.access_type == signal.access
    assert len(found) == signal.type.bits
    mapped = any(signal in layout for layout in od.TPDO_LAYOUT)
    assert not mapped or found.pdo_mappable


def test_the_data_sheet_lists_nothing_that_the_dictionary_has_not() -> None:
    listed = set[tuple[int, int]]()
    for index, entry in cast(Any, loaded()).items():
        if index >= 0x2000:
            listed |= {(index, subindex) for subindex in entry if subindex} if hasattr(entry, "subindices") else {
                (index, 0)
            }
    assert listed == {(s.index, s.subindex) for s in SIGNALS if s.index >= 0x2000} | {CAPTURE_DATA, CONTROL}


@pytest.mark.parametrize("number", range(4))
def test_the_data_sheet_has_the_pdos_as_they_are_sent(number: int) -> None:
    dictionary = loaded(node_id=5)
    assert variable(dictionary, 0x1800 + number, 1).default == 0x185 + 0x100 * number
    assert variable(dictionary, 0x1800 + number, 2).default == 254  # on events of the drive's own
    mapping = [variable(dictionary, 0x1A00 + number, k).default for k in range(1, len(MAPPING[number]) + 1)]
    assert tuple(mapping) == MAPPING[number]
    assert variable(dictionary, 0x1A00 + number, 0).default == len(MAPPING[number])


def test_the_device_is_told_as_a_servo_drive() -> None:
    dictionary: Any = loaded()
    assert dictionary[0x1000].default == 0x00020192  # CiA 402: additional information 2, profile 402
    assert dictionary[0x1008].default == "pmsm-bench virtual drive"
    assert dictionary[0x1017].default == 100
    assert [dictionary[0x1018][k].default for k in (1, 2, 3)] == [0, 0x504D534D, 1]


# CiA 306, 4.6: lists of objects and their counts


@pytest.mark.parametrize("title", ["MandatoryObjects", "OptionalObjects", "ManufacturerObjects"])
def test_a_list_of_objects_is_numbered_and_counted(title: str) -> None:
    section = dict(sheet()[title])
    count = int(section.pop("SupportedObjects"))
    assert list(section) == [str(k) for k in range(1, count + 1)]
    indices = [int(text, 16) for text in section.values()]
    assert indices == sorted(set(indices))
    allowed = {"MandatoryObjects": {0x1000, 0x1001, 0x1018}, "OptionalObjects": {*range(0x1000, 0x2000), *range(
        0x6000, 0x10000)}, "ManufacturerObjects": set(range(0x2000, 0x6000))}
    assert set(indices) <= allowed[title]


def test_the_mandatory_objects_are_the_standards_three() -> None:
    section = sheet()["MandatoryObjects"]
    assert [int(section[str(k)], 16) for k in (1, 2, 3)] == [0x1000, 0x1001, 0x1018]


def test_every_listed_object_has_a_section_and_every_section_is_listed() -> None:
    parser = sheet()
    listed = [
        int(text, 16)
        for title in ("MandatoryObjects", "OptionalObjects", "ManufacturerObjects")
        for key, text in parser[title].items()
        if key != "SupportedObjects"
    ]
    assert len(listed) == len(set(listed))
    sections = [int(name, 16) for name in parser.sections() if re.fullmatch("[0-9A-F]{4}", name)]
    assert sorted(listed) == sorted(sections)


def test_a_records_number_of_sub_objects_is_right() -> None:
    parser = sheet()
    for name in parser.sections():
        if not re.fullmatch("[0-9A-F]{4}", name) or parser[name]["ObjectType"] in ("0x2", "0x7"):
            continue
        subs = [int(s[7:], 16) for s in parser.sections() if re.fullmatch(f"{name}sub[0-9A-F]+", s)]
        assert int(parser[name]["SubNumber"]) == len(subs)
        counts_what_is_there = name == "1003" or name.startswith("1A")  # errors, entries mapped
        assert int(parser[f"{name}sub0"]["DefaultValue"], 16) == max(subs) or counts_what_is_there
        assert subs == list(range(max(subs) + 1))


def test_every_entry_names_type_access_and_mapping() -> None:
    parser = sheet()
    for name in parser.sections():
        if re.fullmatch("[0-9A-F]{4}(sub[0-9A-F]+)?", name) and parser[name]["ObjectType"] == "0x7":
            entry = parser[name]
            assert entry["ParameterName"]
            assert int(entry["DataType"], 16) in {5, 6, 7, 3, 4, 8, 9, 0xF}
            assert entry["AccessType"] in {"const", "ro", "rw"}
            assert entry["PDOMapping"] in {"0", "1"}
            assert len(entry["ParameterName"]) <= 241  # CiA 306, 4.6.3


def test_the_data_sheet_is_the_same_every_time_and_plain_ascii() -> None:
    assert od.eds() == od.eds()
    assert od.eds().isascii()
    assert layout_id() > 0
