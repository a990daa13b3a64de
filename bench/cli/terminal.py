"""What is shown in a terminal: texts as they are, whatever file names and messages bring with them.

No markup, no emoji; control characters, which could move the cursor or hide text, are shown as `\\x1b`.
"""

import re
from typing import Any, Final

from rich.console import Console
from rich.progress import TextColumn
from rich.text import Text

# Control characters, those that turn the direction of writing, and bytes of names that are no text
_HIDDEN: Final = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")


def visible(text: object) -> str:
    """A text in which nothing is hidden; its lines and tabs stay."""
    return _HIDDEN.sub(lambda found: ascii(found[0])[1:-1], str(text))


def one_line(text: object) -> str:
    """A name, or a sentence with names in it: visible, on one line."""
    return visible(text).replace("\n", "\\n").replace("\t", "\\t")


class Terminal(Console):
    """Standard output, or standard error."""

    def __init__(self, **options: Any) -> None:
        super().__init__(highlight=False, markup=False, emoji=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """A text as it is."""
        as_it_is: dict[str, Any] = {**options, "markup": False, "emoji": False}
        return super().render_str(visible(text), **as_it_is)


class Told(TextColumn):
    """A column of a bar that says what is being done."""

    def __init__(self) -> None:
        super().__init__("{task.description}", markup=False)

    def render(self, task: Any) -> Text:
        """The description, visible."""
        return Text(one_line(task.description))
