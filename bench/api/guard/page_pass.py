"""The pass of a page: a cookie for who has shown the token in a browser, whose event streams send no other header.

It is made of the token, and is not the token: another token ends it, and who reads it learns no token.
"""

import hashlib
import hmac
import time
from typing import Final

_LASTS: Final = 7 * 86400  # s
_LONGEST: Final = 100  # letters


def given_by(name: str, token: str, *, secure: bool) -> str:
    """The value of a Set-Cookie header."""
    until = int(time.time()) + _LASTS
    end = "; Secure" if secure else ""
    return f"{name}={until}.{_proof(until, token)}; Max-Age={_LASTS}; Path=/; HttpOnly; SameSite=Strict{end}"


def holds(value: str, token: str) -> bool:
    """Whether a cookie's value is a pass that this token gave, and that still lasts."""
    until, _, proof = value[:_LONGEST].partition(".")
    if not (until.isascii() and until.isdigit()):
        return False
    return hmac.compare_digest(proof.encode(), _proof(int(until), token).encode()) and int(until) > time.time()


def _proof(until: int, token: str) -> str:
    return hmac.new(token.encode(), f"page until {until}".encode(), hashlib.sha256).hexdigest()
