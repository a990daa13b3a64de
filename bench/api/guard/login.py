"""The page that asks for the token, and takes it. Plain HTML: nothing else is handed out before."""

from html import escape
from typing import Final
from urllib.parse import parse_qs

from starlette.requests import ClientDisconnect, Request
from starlette.responses import HTMLResponse, RedirectResponse, Response

from bench.api.guard.access import Access

PATH: Final = "/login"
_LONGEST: Final = 4096  # bytes of a form
_STYLE: Final = (
    "body{font:16px system-ui,sans-serif;max-width:30rem;margin:12vh auto;padding:0 16px}"
    "input,button{font:inherit;padding:6px 10px;width:100%;box-sizing:border-box;margin-top:8px}"
    ":root{color-scheme:light dark}"
)


def asking(said: str = "") -> HTMLResponse:
    """The form; `said`, what was wrong with the last."""
    return HTMLResponse(
        '<!doctype html><html lang="en"><head><meta charset="utf-8"><title>pmsm-bench</title>'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><style>{_STYLE}</style></head><body>'
        f'<h1>pmsm-bench</h1><p role="alert">{escape(said)}</p><form method="post" action="{PATH}"><label>Token, as '
        "<code>pmsm-bench token</code> prints it on the service's machine, with <code>--config FILE</code> where it "
        "has a configuration"
        '<input name="token" type="password" required autofocus autocomplete="current-password"></label>'
        '<button>Open the page</button></form><p>Came here by a link, and logged in before? <a href="/">Open the page'
        "</a></p></body></html>\n", 401 if said else 200,
    )  # fmt: skip


async def answer(request: Request, access: Access) -> Response:
    """To a form: a pass and the way to the page, or the form again."""
    if request.method != "POST":
        return asking()
    text = b""
    try:
        async for part in request.stream():
            text += part
            if len(text) > _LONGEST:
                return asking("That is too long for a token.")
    except ClientDisconnect:
        return asking("The form broke off.")
    said = parse_qs(text.decode("utf-8", "replace")).get("token", [""])[0]
    if access.token is None or not access.token.is_it(said.strip()):
        return asking("That is not the token.")
    return RedirectResponse("/", 303, {"Set-Cookie": access.cookie()})
