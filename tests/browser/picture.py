"""`python -m tests.browser.picture [FILE]`: the README's picture of the page, of an emulated drive that turns.

Taken where all four parameters are told and their plots have run for a while; Debian: chromium, chromium-driver.
"""

import sys
import tempfile
import time
from pathlib import Path
from typing import Final

from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

from tests.browser.chromium import chromium
from tests.conftest import bench_up

FILE: Final = Path(".readme") / "page.png"
SIZE: Final = (1200, 760)  # px
SETTLED: Final = 60.0  # s of plots
PATIENCE: Final = 60.0  # s
_TOLD: Final = '.tile[data-status="ok"]'


def taken(file: Path) -> None:
    """Write the picture."""
    width, height = SIZE
    size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
    with (
        bench_up() as bench, tempfile.TemporaryDirectory() as profile,
        chromium(Path(profile), "hide-scrollbars") as chrome,
    ):  # fmt: skip
        chrome.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        chrome.get(bench.url)
        WebDriverWait(chrome, PATIENCE).until(lambda page: len(page.find_elements(By.CSS_SELECTOR, _TOLD)) == 4)
        time.sleep(SETTLED)
        chrome.save_screenshot(str(file))


if __name__ == "__main__":
    taken(Path(sys.argv[1]) if len(sys.argv) > 1 else FILE)
