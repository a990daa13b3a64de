"""`python -m emulator conceal`: options to a suite, its progress and its end."""

import argparse
import signal
import sys
import time
from concurrent.futures import BrokenExecutor
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

from emulator.bounds import ScenarioError
from emulator.conceal import __doc__ as about
from emulator.conceal.populations import EFFECTS, FAMILIES, KINDS, POPULATIONS, STRANGERS
from emulator.conceal.recording import Choice
from emulator.conceal.suite import Suite, make
from emulator.scenario.motors import MOTORS

_EVERY = 5.0  # s, between lines of progress where standard error is no terminal
_NAME = "emulator conceal"


def main(arguments: list[str]) -> int:
    """Make a suite. 0 at the end, 2 where it cannot be, 1 where it cannot be written, 130 after Ctrl-C."""
    suite = _suite(_parser().parse_args(arguments))
    signal.signal(signal.SIGTERM, _interrupt)
    progress = _Progress(suite.count)
    try:
        made = make(suite, progress)
    except ScenarioError as error:
        return progress.end(str(error), 2)
    except OSError as error:
        return progress.end(f"cannot write {error.filename or 'a file'}: {error.strerror or error}", 1)
    except BrokenExecutor:
        return progress.end(f"one of its processes was ended from outside; what is in {suite.out} is whole", 1)
    except KeyboardInterrupt:
        return progress.end(f"interrupted; what is in {suite.out} is whole", 130)
    return progress.end(f"{made} recordings in {suite.out}, their answers in {suite.answers}", 0)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        f"python -m {_NAME}", description=about, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, required=True, metavar="N", help="recordings to make")
    parser.add_argument("--seed", type=int, required=True, metavar="S", help="decides all that is drawn")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="for recordings and nominal machines")
    parser.add_argument("--answers", type=Path, required=True, metavar="DIR2", help="for what they conceal")
    parser.add_argument(
        "--class", dest="kinds", nargs="+", default=KINDS, metavar="CLASS",
        help=f"drawn from, each as likely: kinds {', '.join(KINDS)} (default all); effects {', '.join(EFFECTS)}; "
        f"strangers {', '.join(STRANGERS)}; "
        + "; ".join(f"{kind} for one of {', '.join(classes)}" for kind, classes in FAMILIES.items()),
    )  # fmt: skip
    parser.add_argument(
        "--chain", action="store_true", help="with a measuring chain drawn for each, and two current sensors in most"
    )
    parser.add_argument(
        "--current-sensors", type=int, default=0, choices=(2, 3), help="of each drive (default: as drawn, or three)"
    )
    parser.add_argument(
        "--size", nargs=2, type=float, default=(0.0, 1.0), metavar=("LOW", "HIGH"),
        help="part of each class's range, 0 to 1 of its logarithm (default 0 1)",
    )  # fmt: skip
    parser.add_argument(
        "--motor", dest="motors", nargs="+", default=tuple(MOTORS), metavar="NAME",
        help=f"drawn from: {', '.join(MOTORS)} (default all)",
    )  # fmt: skip
    parser.add_argument("--list", action=_List, help="print the classes, their ranges and why these, and end")
    parser.add_argument("--length", type=float, default=3.0, metavar="S", help="of each recording, s (default 3)")
    parser.add_argument("--workers", type=int, default=0, metavar="N", help="processes (default: one per core)")
    return parser


class _List(argparse.Action):
    """Print the populations and end, as --help does."""

    def __init__(self, option_strings: list[str], dest: str, **given: Any) -> None:
        super().__init__(option_strings, dest, nargs=0, **given)

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        for name, each in POPULATIONS.items():
            unit = "" if each.unit == "1" else f" {each.unit}"
            span = f"{each.low:g}" if each.low == each.high else f"{each.low:.3g} to {each.high:.3g}"
            print(f"{name:20} {each.size}: {span}{unit} ({each.why})")
        parser.exit()


def _suite(options: argparse.Namespace) -> Suite:
    low, high = options.size
    kinds, motors = tuple(options.kinds), tuple(options.motors)
    length, sensors = options.length, options.current_sensors
    choice = Choice(options.seed, kinds, (low, high), motors, length, options.chain, sensors)
    return Suite(choice, options.count, options.out, options.answers, options.workers)


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt


class _Progress:
    """How far it is, on standard error: one line that is written over, or on no terminal one now and then."""

    def __init__(self, count: int) -> None:
        self._count, self._started, self._told = count, 0.0, 0.0
        self._live = sys.stderr.isatty()
        self._say("getting ready, which takes half a minute the first time")

    def __call__(self, done: int) -> None:
        now = time.monotonic()
        if done == 0:
            self._started = self._told = now
            return
        if done < self._count and now - self._told < (0.1 if self._live else _EVERY):
            return
        self._told, taken = now, max(now - self._started, 1e-3)
        left = f"{(self._count - done) * taken / done:.0f} s left" if done < self._count else f"{taken:.0f} s"
        self._say(f"{done} of {self._count} recordings, {done / taken:.3g} a second, {left}")

    def _say(self, text: str) -> None:
        before, after = ("\r", "\033[K") if self._live else ("", "\n")
        print(f"{before}{_NAME}: {text}", end=after, file=sys.stderr, flush=True)

    def end(self, said: str, code: int) -> int:
        """The last line, and the exit code it goes with."""
        before = "\r\033[K" if self._live else ""
        print(f"{before}{_NAME}: {said}", file=sys.stderr, flush=True)
        return code
