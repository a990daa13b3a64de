"""The address of a Modbus drive: what it says, and in one sentence what is wrong with one that says nothing."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.connect import check_url
from drivers.errors import ConnectError
from drivers.wire.modbus_url import ModbusUrl, SerialPlace, TcpPlace, parse_modbus_url


@pytest.mark.parametrize(
    ("url", "found"),
    [
        ("modbus+tcp://drive:1502/1", ModbusUrl(TcpPlace("drive", 1502), 1)),
        ("modbus+tcp://10.0.0.7/255", ModbusUrl(TcpPlace("10.0.0.7", 502), 255)),
        ("modbus+tcp://[::1]:502/3", ModbusUrl(TcpPlace("::1", 502), 3)),
        ("modbus+rtu:///dev/ttyUSB0?baudrate=115200/1", ModbusUrl(SerialPlace("/dev/ttyUSB0"), 1)),
        ("modbus+rtu:///dev/ttyUSB0/247", ModbusUrl(SerialPlace("/dev/ttyUSB0"), 247)),
        ("modbus+rtu:///dev/ttyS1?baudrate=19200&parity=E&stopbits=2/9",
         ModbusUrl(SerialPlace("/dev/ttyS1", 19200, "E", 2), 9)),
        ("modbus+rtu://COM3/1", ModbusUrl(SerialPlace("COM3"), 1)),
        ("modbus+rtu://socket://host:4001/1", ModbusUrl(SerialPlace("socket://host:4001"), 1)),
        ("modbus+rtu://rfc2217://host:4001?baudrate=9600/1", ModbusUrl(SerialPlace("rfc2217://host:4001", 9600), 1)),
    ],
)
def test_an_address_is_taken_apart(url: str, found: ModbusUrl) -> None:
    assert parse_modbus_url(url) == found
    check_url(url)


def test_a_unit_has_a_name_for_messages() -> None:
    assert str(parse_modbus_url("modbus+tcp://drive/1")) == "unit 1 at drive:502"
    assert str(parse_modbus_url("modbus+rtu:///dev/ttyUSB0/2")) == "unit 2 on /dev/ttyUSB0"


@pytest.mark.parametrize(
    ("url", "sentence"),
    [
        ("modbus://drive/1", r"expected a URL that starts with modbus\+tcp:// or modbus\+rtu://, got 'modbus://drive/1'"),
        ("modbus+tcp:drive/1", r"expected a URL that starts with"),
        ("modbus+tcp://drive", r"expected modbus\+tcp://HOST\[:PORT\]/UNIT or modbus\+rtu://DEVICE"),
        ("modbus+tcp:///1", r"expected modbus\+tcp://HOST\[:PORT\]/UNIT"),
        ("modbus+tcp://drive/0", r"expected a unit of 1 to 255 at the end of 'modbus\+tcp://drive/0', got '0'"),
        ("modbus+rtu:///dev/ttyUSB0/248", r"expected a unit of 1 to 247 at the end of .*, got '248'"),
        ("modbus+rtu:///dev/ttyUSB0", r"expected a unit of 1 to 247 at the end of .*, got 'ttyUSB0'"),
        ("modbus+tcp://drive/one", r"got 'one'"),
        ("modbus+tcp://drive:70000/1", r"expected modbus\+tcp://HOST\[:PORT\]/UNIT, got .* \(Port out of range"),
        ("modbus+tcp://drive:0/1", r"expected modbus\+tcp://HOST"),
        ("modbus+tcp://drive:x/1", r"expected modbus\+tcp://HOST"),
        ("modbus+tcp://drive/a/1", r"expected modbus\+tcp://HOST"),
        ("modbus+tcp://drive?baudrate=9600/1", r"expected modbus\+tcp://HOST"),
        ("modbus+rtu:///dev/a?baudrate/1", r"expected option=value after the '\?' of .*, got 'baudrate'"),
        ("modbus+rtu:///dev/a?speed=1/1", r"expected the options baudrate, .* and timeout in .*, got speed"),
        ("modbus+rtu:///dev/a?baudrate=fast/1", r"expected a baudrate of 300 to 12000000 in .*, got 'fast'"),
        ("modbus+rtu:///dev/a?baudrate=1/1", r"expected a baudrate of 300 to 12000000"),
        ("modbus+rtu:///dev/a?parity=X/1", r"expected a parity of N, E, O in .*, got 'X'"),
        ("modbus+rtu:///dev/a?stopbits=3/1", r"expected stopbits of 1 or 2 in .*, got '3'"),
        ("modbus+tcp://drive?timeout=0/1", r"expected a timeout of 0.05 to 10 s in .*, got '0'"),
        ("modbus+rtu:///dev/a?timeout=soon/1", r"expected a timeout of 0.05 to 10 s in .*, got 'soon'"),
        ("modbus+rtu://?baudrate=9600/1", r"expected modbus\+rtu://DEVICE"),
    ],
)
def test_an_address_that_is_none_is_one_sentence(url: str, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence) as caught:
        parse_modbus_url(url)
    assert "\n" not in str(caught.value)


@given(st.text() | st.from_regex(r"modbus\+(tcp|rtu)://[a-z:/0-9?=&\[\]@#]*", fullmatch=True))
@settings(deadline=None)
def test_any_text_is_an_address_or_told_not_to_be(text: str) -> None:
    try:
        parse_modbus_url(text)
    except ValueError as error:
        assert str(error).startswith("expected ")


def test_the_door_of_the_drivers_tells_all_its_schemes() -> None:
    with pytest.raises(ConnectError, match=r"modbus\+tcp:// or modbus\+rtu://"):
        check_url("profibus://1")


@pytest.mark.parametrize("url", ["modbus+tcp://drive?timeout=1.5/1", "modbus+rtu:///dev/a?baudrate=9600&timeout=1.5/1"])
def test_an_address_may_say_how_long_answers_take(url: str) -> None:
    assert parse_modbus_url(url).timeout == 1.5
    assert parse_modbus_url("modbus+tcp://drive/1").timeout is None
