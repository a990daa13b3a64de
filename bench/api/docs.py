"""FastAPI's interactive page at /docs. Its script and style come from a package: a bench often has no outer network."""

from importlib import resources
from pathlib import Path
from typing import Final

from fastapi import FastAPI
from fastapi.openapi.docs import get_swagger_ui_html
from fastapi.responses import FileResponse, HTMLResponse

from bench.api.exchange.kinds import READS

_ASSETS: Final = {"swagger-ui-bundle.js": "text/javascript", "swagger-ui.css": "text/css"}


def install(app: FastAPI) -> None:
    """Serve the page and what it needs."""
    folder = Path(str(resources.files("fastapi_offline"))) / "static"

    @app.api_route("/docs", methods=[*READS], include_in_schema=False)
    def reference() -> HTMLResponse:
        script, style = (f"/assets/{name}" for name in _ASSETS)
        return get_swagger_ui_html(
            openapi_url="/openapi.json", title=f"{app.title} REST", swagger_js_url=script, swagger_css_url=style,
            swagger_favicon_url="/favicon.ico",
        )

    def asset(name: str, kind: str) -> None:
        @app.api_route(f"/assets/{name}", methods=[*READS], include_in_schema=False)
        def file() -> FileResponse:
            return FileResponse(folder / name, media_type=kind, headers={"Cache-Control": "max-age=86400"})

    for name, kind in _ASSETS.items():
        asset(name, kind)
