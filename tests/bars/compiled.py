"""`python -m tests.bars.compiled`: compile, once, what tests in several processes would each compile for themselves."""

import tempfile
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from tests.bars.bench_diagnose import conceal, seconds


def _estimator() -> None:
    from bench.live.method import warm_up
    from estimator.diagnosis import watch as detect

    warm_up()
    detect.warm_up()


def main() -> None:
    """The emulator's kernels beside the estimator's; then those of the diagnosis, which takes a recording."""
    with tempfile.TemporaryDirectory() as folder, ProcessPoolExecutor(2, get_context("spawn")) as pool:
        for started in (pool.submit(conceal, "two", 1.0, Path(folder)), pool.submit(_estimator)):
            started.result()
        seconds("two", 1.0, Path(folder))


if __name__ == "__main__":
    main()
