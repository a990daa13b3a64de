"""The address of a drive on a serial line: what it names, and the sentence for what names nothing."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.connect import check_url, connect
from drivers.errors import ConnectError
from drivers.wire.uart_url import UartUrl, parse_uart_url


@pytest.mark.parametrize(
    ("url", "meant", "line", "words"),
    [
        ("uart:///dev/ttyUSB0?baudrate=115200", UartUrl("/dev/ttyUSB0", baudrate=115200),
         "/dev/ttyUSB0", "/dev/ttyUSB0 at 115200 baud"),
        ("uart:///dev/ttyACM0", UartUrl("/dev/ttyACM0"), "/dev/ttyACM0", "/dev/ttyACM0 at 3000000 baud"),
        ("uart://COM12?baudrate=921600", UartUrl("COM12", baudrate=921600), "COM12", "COM12 at 921600 baud"),
        ("uart://socket://127.0.0.1:7000", UartUrl(protocol="socket", host="127.0.0.1", port=7000),
         "socket://127.0.0.1:7000", "socket://127.0.0.1:7000"),
        ("uart://rfc2217://lab:2217?baudrate=57600&timeout=5",
         UartUrl(protocol="rfc2217", host="lab", port=2217, baudrate=57600, options={"timeout": "5"}),
         "rfc2217://lab:2217?timeout=5", "rfc2217://lab:2217 at 57600 baud"),
    ],
)
def test_a_good_url_names_a_line(url: str, meant: UartUrl, line: str, words: str) -> None:
    assert parse_uart_url(url) == meant
    assert (meant.line, str(meant)) == (line, words)
    check_url(url)


BAD = [
    ("uart:/dev/ttyUSB0", r"expected a URL that starts with uart://, got 'uart:/dev/ttyUSB0'"),
    ("serial:///dev/ttyUSB0", r"expected a URL that starts with uart://"),
    ("uart://", r"expected uart:///DEVICE\[\?baudrate=N\], uart://COM3"),
    ("uart:///", r"expected uart:///DEVICE"),
    ("uart:///dev/", r"expected uart:///DEVICE"),
    ("uart://dev/ttyUSB0", r"expected uart:///DEVICE"),
    ("uart:///dev/ttyUSB0?baudrate", r"expected uart:///DEVICE.* \(bad query field: 'baudrate'\)"),
    ("uart:///dev/ttyUSB0?baudrate=fast", r"expected a baud rate of 1200 to 12000000 in 'uart:.*', got 'fast'"),
    ("uart:///dev/ttyUSB0?baudrate=0", r"expected a baud rate of 1200 to 12000000 in .*, got '0'"),
    ("uart:///dev/ttyUSB0?baudrate=99999999", r"expected a baud rate of 1200 to 12000000"),
    ("uart:///dev/ttyUSB0?parity=E", r"a serial device takes no option but baudrate, got parity in 'uart:"),
    ("uart://spy:///dev/ttyUSB0", r"expected socket:// or rfc2217:// after uart:// in 'uart://spy:"),
    ("uart://socket://127.0.0.1", r"expected HOST:PORT with a port of 1 to 65535 in .*, got '127.0.0.1'"),
    ("uart://socket://:7000", r"expected HOST:PORT with a port of 1 to 65535 in .*, got ':7000'"),
    ("uart://socket://127.0.0.1:65536", r"expected HOST:PORT with a port of 1 to 65535"),
    ("uart://rfc2217://lab:2217/x", r"expected HOST:PORT with a port of 1 to 65535 in .*, got 'lab:2217/x'"),
]


@pytest.mark.parametrize(("url", "sentence"), BAD)
def test_a_bad_url_is_told_in_a_sentence(url: str, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        parse_uart_url(url)


@pytest.mark.parametrize("url", [url for url, _ in BAD])
def test_a_bad_url_is_a_connect_error_and_opens_nothing(url: str) -> None:
    for call in (check_url, connect):
        with pytest.raises(ConnectError):
            call(url)


@given(st.text())
def test_any_text_is_a_line_or_a_sentence(text: str) -> None:
    try:
        place = parse_uart_url(f"uart://{text}")
    except ValueError as error:
        assert "expected" in str(error) or "takes no option" in str(error)
    else:
        assert place.line
