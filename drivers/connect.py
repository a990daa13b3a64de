"""A URL to a connected drive: the one door of this room."""

from drivers.drive import Drive
from drivers.errors import ConnectError


def check_url(url: str) -> None:
    """Raise ConnectError, in a sentence, when the URL cannot name a drive. Opens nothing."""
    scheme = url.partition("://")[0]
    if scheme != "canopen":
        raise ConnectError(f"expected a drive URL that starts with canopen://, got {url!r}")
    from drivers.wire.can_url import parse_can_url

    try:
        parse_can_url(url)
    except ValueError as error:
        raise ConnectError(str(error)) from None


def connect(url: str) -> Drive:
    """Connect to the drive at a URL. Raises ConnectError when it is not there or not such a drive."""
    check_url(url)
    from drivers.canopen_drive import CanopenDrive
    from drivers.wire.can_url import parse_can_url

    return CanopenDrive(parse_can_url(url))
