"""Debian's Chromium, without a window, by its driver."""

from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from selenium.webdriver import Chrome, ChromeOptions
from selenium.webdriver.chrome.service import Service

CHROMIUM: Final = Path("/usr/bin/chromium")
CHROMEDRIVER: Final = Path("/usr/bin/chromedriver")
_FLAGS: Final = ("headless", "no-sandbox", "disable-gpu", "disable-dev-shm-usage", "disable-background-networking")


@contextmanager
def chromium(profile: Path, *flags: str, logs: Mapping[str, str] | None = None) -> Generator[Chrome]:
    """One with a profile of its own and more flags; `logs`: what is kept of which kind."""
    options = ChromeOptions()
    options.binary_location = str(CHROMIUM)
    for flag in (*_FLAGS, *flags, f"user-data-dir={profile}"):
        options.add_argument(f"--{flag}")
    if logs is not None:
        options.set_capability("goog:loggingPrefs", dict(logs))
    chrome = Chrome(options=options, service=Service(str(CHROMEDRIVER)))
    try:
        yield chrome
    finally:
        chrome.quit()
