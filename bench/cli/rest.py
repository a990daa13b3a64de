"""The service's REST interface as the command line asks it: every failure is a BenchError with a sentence."""

from typing import Any, cast
from urllib.parse import quote

import httpx

from bench.errors import BenchError, UnavailableError


class Rest:
    """A service at an address."""

    def __init__(self, client: httpx.Client, service: str) -> None:
        self._client, self._service = client, service

    def call(
        self, method: str, *path: str, body: object = None, key: str = "", query: dict[str, str] | None = None
    ) -> dict[str, Any]:
        """The JSON object at /api/drives/PATH, which has `key`. Raises UnavailableError where nobody answers."""
        try:
            response = self._client.request(method, self._address(path), json=body, params=query)
            content = response.json()
        except (httpx.HTTPError, httpx.InvalidURL, ValueError) as error:
            raise UnavailableError(f"no bench service answers at {self._service}: {error}") from None
        if response.is_success and isinstance(content, dict) and key in content:
            return cast(dict[str, Any], content)
        if isinstance(content, dict) and "detail" in content:
            raise BenchError(str(cast(dict[str, Any], content)["detail"]))
        raise BenchError(f"expected a bench service at {self._service}, got another answer ({response.status_code})")

    def download(self, *path: str) -> bytes:
        """The file at /api/drives/PATH."""
        try:
            return self._client.get(self._address(path)).raise_for_status().content
        except (httpx.HTTPError, httpx.InvalidURL) as error:
            raise UnavailableError(f"the service at {self._service} did not hand out the file: {error}") from None

    def _address(self, path: tuple[str, ...]) -> str:
        return "/".join([f"{self._service.rstrip('/')}/api/drives", *(quote(part, safe="") for part in path)])
