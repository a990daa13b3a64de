"""The OpenAPI document against the running service: schemathesis makes requests from it, and holds answers to it."""

import os
import subprocess
import sys
from pathlib import Path

import httpx
import pytest

from tests.conftest import bench_up

pytestmark = [pytest.mark.slow, pytest.mark.live]

HOOKS = "tests.support.schemathesis_hooks"
EXAMPLES = os.environ.get("SCHEMATHESIS_EXAMPLES", "10")  # for each route and phase


def test_every_answer_to_generated_requests_is_as_the_document_says(tmp_path: Path) -> None:
    """All checks of schemathesis, over examples, coverage, fuzzing and sequences of requests."""
    with bench_up() as bench:
        done = subprocess.run(
            [Path(sys.executable).with_name("schemathesis"),
             "--config-file", Path(__file__).with_name("schemathesis.toml"),
             "run", f"{bench.url}/openapi.json", "--checks", "all", "--max-examples", EXAMPLES, "--continue-on-failure",
             "--seed", "1", "--no-shrink", "--no-color"],
            capture_output=True, text=True, timeout=1800.0, check=False, cwd=tmp_path,
            env=os.environ | {"SCHEMATHESIS_HOOKS": HOOKS, "PYTHONPATH": str(Path(__file__).parents[3])},
        )  # fmt: skip
        assert done.returncode == 0, done.stdout[-6000:]
        assert "62 selected / 62 total" in done.stdout
        assert httpx.get(f"{bench.url}/api/health").json()["status"] == "ok"
