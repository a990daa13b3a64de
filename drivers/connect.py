"""A URL to a connected drive: the one door of this room."""

from drivers.drive import Drive
from drivers.errors import ConnectError

SCHEMES = ("canopen", "modbus+tcp", "modbus+rtu", "uart")


def check_url(url: str) -> None:
    """Raise ConnectError, in a sentence, when the URL cannot name a drive. Opens nothing."""
    try:
        _parsed(url)
    except ValueError as error:
        raise ConnectError(str(error)) from None


def connect(url: str) -> Drive:
    """Connect to the drive at a URL. Raises ConnectError when it is not there or not such a drive."""
    check_url(url)
    if url.startswith("uart://"):
        from drivers.uart.drive import UartDrive
        from drivers.wire.uart_url import parse_uart_url

        return UartDrive(parse_uart_url(url))
    if url.startswith("modbus+"):
        from drivers.modbus.drive import ModbusDrive
        from drivers.wire.modbus_url import parse_modbus_url

        return ModbusDrive(parse_modbus_url(url))
    from drivers.canopen.drive import CanopenDrive
    from drivers.wire.can_url import parse_can_url

    return CanopenDrive(parse_can_url(url))


def _parsed(url: str) -> object:
    scheme = url.partition("://")[0]
    if scheme == "canopen":
        from drivers.wire.can_url import parse_can_url

        return parse_can_url(url)
    if scheme == "uart":
        from drivers.wire.uart_url import parse_uart_url

        return parse_uart_url(url)
    if scheme in ("modbus+tcp", "modbus+rtu"):
        from drivers.wire.modbus_url import parse_modbus_url

        return parse_modbus_url(url)
    raise ValueError(f"expected a drive URL that starts with {' or '.join(f'{s}://' for s in SCHEMES)}, got {url!r}")
