"""What is shown in a terminal: texts as they are, whatever file names and messages bring with them.

No markup, no emoji; control characters, which could move the cursor or hide text, are shown as `\\x1b`.
"""

import re
from collections.abc import Callable, Generator
from contextlib import contextmanager
from functools import partial
from typing import Any, Final

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, TextColumn
from rich.text import Text

# Control characters, those that turn the direction of writing, and bytes of names that are no text
_HIDDEN: Final = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")

_WHOLE: Final = 1e15  # up to which a float tells each whole number


def visible(text: object) -> str:
    """A text in which nothing is hidden; its lines and tabs stay."""
    return _HIDDEN.sub(lambda found: ascii(found[0])[1:-1], str(text))


def one_line(text: object) -> str:
    """A name, or a sentence with names in it: visible, on one line."""
    return visible(text).replace("\n", "\\n").replace("\t", "\\t")


def plain(value: float) -> str:
    """A number as it is: a whole one to its last digit, any other to six."""
    return f"{value:.0f}" if value.is_integer() and abs(value) < _WHOLE else f"{value:.6g}"


class Terminal(Console):
    """Standard output, or standard error."""

    def __init__(self, **options: Any) -> None:
        super().__init__(highlight=False, markup=False, emoji=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        as_it_is: dict[str, Any] = {**options, "markup": False, "emoji": False}
        return super().render_str(visible(text), **as_it_is)


class Told(TextColumn):
    """A column of a bar that says what is being done."""

    def __init__(self) -> None:
        super().__init__("{task.description}", markup=False)

    def render(self, task: Any) -> Text:
        return Text(one_line(task.description))


@contextmanager
def bar(
    said: str, total: float | None, *columns: ProgressColumn, console: Terminal | None = None,
    redirect_stdout: bool = True,
) -> Generator[Callable[..., None]]:
    """A bar on standard error, where that is a terminal; changed by `completed` and `description`."""
    console = console or Terminal(stderr=True)
    progress = Progress(
        Told(), BarColumn(), *columns, console=console, transient=True, disable=not console.is_terminal,
        redirect_stdout=redirect_stdout,
    )
    with progress:
        yield partial(progress.update, progress.add_task(said, total=total))
