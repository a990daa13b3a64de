"""Where the real recordings are. They are no part of the project; what needs them says so where they are not there."""

import os
from pathlib import Path
from typing import Final

REAL_DATA: Final = Path(
    os.environ.get("PMSM_BENCH_DATA") or Path(__file__).resolve().parents[3] / "shared" / "data"
)
