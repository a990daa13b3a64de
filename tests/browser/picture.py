"""`python -m tests.browser.picture [FILE]`: the README's picture of the page, of an emulated drive that turns.

Taken where all four parameters are told and their plots have run for a while; Debian: chromium, chromium-driver.
"""

import sys
import tempfile
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from selenium.webdriver import Chrome, ChromeOptions
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

from tests.conftest import bench_up

FILE: Final = Path(".readme") / "page.png"
SIZE: Final = (1200, 760)  # px
SETTLED: Final = 60.0  # s of plots
PATIENCE: Final = 60.0  # s
_TOLD: Final = '.tile[data-status="ok"]'


@contextmanager
def chromium() -> Generator[Chrome]:
    """Without a window, of exactly the picture's size."""
    with tempfile.TemporaryDirectory() as profile:
        options = ChromeOptions()
        options.binary_location = "/usr/bin/chromium"
        for flag in ("headless", "no-sandbox", "disable-gpu", "disable-dev-shm-usage", "hide-scrollbars"):
            options.add_argument(f"--{flag}")
        options.add_argument(f"--user-data-dir={profile}")
        chrome = Chrome(options=options, service=Service("/usr/bin/chromedriver"))
        try:
            width, height = SIZE
            size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
            chrome.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
            yield chrome
        finally:
            chrome.quit()


def taken(file: Path) -> None:
    """Write the picture."""
    with bench_up() as bench, chromium() as chrome:
        chrome.get(bench.url)
        WebDriverWait(chrome, PATIENCE).until(lambda page: len(page.find_elements(By.CSS_SELECTOR, _TOLD)) == 4)
        time.sleep(SETTLED)
        chrome.save_screenshot(str(file))


if __name__ == "__main__":
    taken(Path(sys.argv[1]) if len(sys.argv) > 1 else FILE)
