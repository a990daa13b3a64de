"""The accessibility rules of axe-core, on the page as it is. Its script comes from npm and is kept in a cache."""

import os
import subprocess
import tarfile
from pathlib import Path
from typing import Final

import pytest
from selenium.webdriver import Chrome

VERSION: Final = "4.14.1"
_RUN: Final = """const [done] = arguments;
axe.run(document).then(({violations}) => done(violations.map(({id, help, nodes}) =>
  `${id}: ${help}: ${nodes.slice(0, 3).map(({html}) => html.slice(0, 160)).join(' | ')}`)));"""


def script() -> str:
    """Of axe-core; skips the test where npm is not there, or reaches no registry."""
    folder = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "pmsm-bench" / "axe"
    file = folder / f"axe-{VERSION}.min.js"
    if not file.exists():
        folder.mkdir(parents=True, exist_ok=True)
        try:
            pack = ["npm", "pack", f"axe-core@{VERSION}"]
            subprocess.run(pack, cwd=folder, check=True, capture_output=True, timeout=60.0)
        except (OSError, subprocess.SubprocessError) as error:
            pytest.skip(f"needs axe-core from npm: {error}")
        with tarfile.open(folder / f"axe-core-{VERSION}.tgz") as packed:
            content = packed.extractfile("package/axe.min.js")
            assert content is not None
            file.write_bytes(content.read())
    return file.read_text(encoding="utf-8")


def violations(browser: Chrome) -> list[str]:
    """What the rules have against the page as it is, a line each."""
    browser.execute_script(script())  # pyright: ignore[reportUnknownMemberType]
    return browser.execute_async_script(_RUN)  # pyright: ignore[reportUnknownMemberType]
