"""Options that every maker of a suite takes."""

import argparse
from pathlib import Path


def suite_parser(module: str, about: str | None) -> argparse.ArgumentParser:
    """Seed, count, folders and processes; a module adds what is its own."""
    parser = argparse.ArgumentParser(f"python -m tests.proof.parts.{module}", description=about)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--count", type=int, required=True)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--answers", type=Path, required=True, metavar="DIR2")
    parser.add_argument("--jobs", type=int, default=1, metavar="N")
    return parser
