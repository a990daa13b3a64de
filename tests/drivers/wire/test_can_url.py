"""The address of a drive on a CAN bus: what it names, and the sentence for what names nothing."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.connect import check_url, connect
from drivers.errors import ConnectError
from drivers.wire.can_url import CanUrl, parse_can_url


@pytest.mark.parametrize(
    ("url", "meant"),
    [
        ("canopen://socketcan/can0/5", CanUrl("socketcan", "can0", 5)),
        ("canopen://socketcan/vcan0/127", CanUrl("socketcan", "vcan0", 127)),
        ("canopen://virtual/bench/1", CanUrl("virtual", "bench", 1)),
        ("canopen://virtual/bench/1/", CanUrl("virtual", "bench", 1)),
        ("canopen://socketcand/127.0.0.1:29536/can0/5", CanUrl("socketcand", "can0", 5, "127.0.0.1", 29536)),
        ("canopen://socketcand/bench-pc:1/can1/9", CanUrl("socketcand", "can1", 9, "bench-pc", 1)),
        ("canopen://pcan/PCAN_USBBUS1/3?bitrate=500000",
         CanUrl("pcan", "PCAN_USBBUS1", 3, options={"bitrate": "500000"})),
        ("canopen://slcan/ttyACM0/3?bitrate=1000000&rtscts=1",
         CanUrl("slcan", "ttyACM0", 3, options={"bitrate": "1000000", "rtscts": "1"})),
        ("canopen://slcan//dev/ttyACM0@115200/3?bitrate=1000000",
         CanUrl("slcan", "/dev/ttyACM0@115200", 3, options={"bitrate": "1000000"})),
    ],
)
def test_a_good_url_names_interface_channel_and_node(url: str, meant: CanUrl) -> None:
    assert parse_can_url(url) == meant
    check_url(url)


BAD = [
    ("", r"expected a URL that starts with canopen://, got ''"),
    ("can0", r"expected a URL that starts with canopen://, got 'can0'"),
    ("modbus://127.0.0.1/5", r"expected a URL that starts with canopen://"),
    ("canopen:socketcan/can0/5", r"expected canopen://socketcan/CHANNEL/NODE, canopen://socketcand/HOST:PORT"),
    ("canopen://", r"expected canopen://socketcan/CHANNEL/NODE"),
    ("canopen://socketcan", r"expected canopen://socketcan/CHANNEL/NODE"),
    ("canopen://socketcan/5", r"expected canopen://socketcan/CHANNEL/NODE"),
    ("canopen://socketcan//5", r"expected canopen://socketcan/CHANNEL/NODE"),
    ("canopen:///can0/5", r"expected canopen://socketcan/CHANNEL/NODE"),
    ("canopen://socketcan/can0/can1/5", r"expected canopen://socketcan/CHANNEL/NODE"),
    ("canopen://socketcan//dev/can0/5", r"expected canopen://socketcan/CHANNEL/NODE"),
    ("canopen://slcan/dev/ttyACM0/5", r"expected canopen://socketcan/CHANNEL/NODE"),
    ("canopen://slcan///5", r"expected canopen://socketcan/CHANNEL/NODE"),
    ("canopen://socketcan/can0/0", r"expected a node of 1 to 127 at the end of '.*', got '0'"),
    ("canopen://socketcan/can0/128", r"expected a node of 1 to 127 at the end of '.*', got '128'"),
    ("canopen://socketcan/can0/-5", r"expected a node of 1 to 127 at the end of '.*', got '-5'"),
    ("canopen://socketcan/can0/five", r"expected a node of 1 to 127 at the end of '.*', got 'five'"),
    ("canopen://socketcan/can0/0x5", r"expected a node of 1 to 127 at the end of '.*', got '0x5'"),
    ("canopen://socketcan/can0/" + "9" * 5000, r"expected a node of 1 to 127 at the end of"),
    ("canopen://socketcan/can0/5?bitrate=500000",
     r"socketcan takes no options, the system sets the bus up \(ip link\); got bitrate in 'canopen://socketcan/can0/5"),
    ("canopen://socketcand/127.0.0.1:29536/can0/5?host=h&port=1&bitrate=500000",
     r"socketcand takes no options, its server sets the bus up; got host, port, bitrate in"),
    ("canopen://socketcand/can0/5", r"expected canopen://socketcand/HOST:PORT/CHANNEL/NODE, got"),
    ("canopen://socketcand/127.0.0.1:29536/5", r"expected canopen://socketcand/HOST:PORT/CHANNEL/NODE, got"),
    ("canopen://socketcand/127.0.0.1:29536//5", r"expected canopen://socketcand/HOST:PORT/CHANNEL/NODE, got"),
    ("canopen://socketcand/127.0.0.1/can0/5", r"expected HOST:PORT with a port of 1 to 65535 in '.*', got '127"),
    ("canopen://socketcand/:29536/can0/5", r"expected HOST:PORT with a port of 1 to 65535 in '.*', got ':29536'"),
    ("canopen://socketcand/127.0.0.1:0/can0/5", r"expected HOST:PORT with a port of 1 to 65535"),
    ("canopen://socketcand/127.0.0.1:65536/can0/5", r"expected HOST:PORT with a port of 1 to 65535"),
    ("canopen://socketcand/127.0.0.1:http/can0/5", r"expected HOST:PORT with a port of 1 to 65535"),
    ("canopen://socketcand/127.0.0.1:29536/can0/", r"expected canopen://socketcand/HOST:PORT/CHANNEL/NODE"),
    ("canopen://[bad/can0/5", r"expected canopen://socketcan/CHANNEL/NODE.* got 'canopen://\[bad/can0/5' \("),
    ("canopen://virtual/bench/5?bitrate", r"expected canopen://socketcan/CHANNEL/NODE.* \(bad query field"),
]


@pytest.mark.parametrize(("url", "sentence"), BAD)
def test_a_bad_url_gets_a_sentence_with_what_was_expected_and_what_came(url: str, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        parse_can_url(url)


@pytest.mark.parametrize("url", [url for url, _ in BAD])
def test_connecting_to_a_bad_url_is_a_connect_error(url: str) -> None:
    with pytest.raises(ConnectError, match=r"expected|takes no options"):
        check_url(url)
    with pytest.raises(ConnectError, match=r"expected|takes no options"):
        connect(url)


@given(st.text() | st.text().map(lambda text: f"canopen://{text}") | st.from_regex(r"canopen://[a-z:/0-9?=&]*"))
def test_any_text_is_a_node_on_a_bus_or_a_sentence(text: str) -> None:
    try:
        url = parse_can_url(text)
    except ValueError as error:
        assert "expected" in str(error)
    else:
        assert 1 <= url.node_id <= 127
        assert url.interface
        assert url.channel
        assert (url.host is None) == (url.interface != "socketcand")


def test_a_bus_is_told_in_words() -> None:
    assert parse_can_url("canopen://socketcan/can0/5").bus == "socketcan can0"
    assert parse_can_url("canopen://socketcand/127.0.0.1:29536/can0/5").bus == "socketcand can0 at 127.0.0.1:29536"
