"""The gallery's page: plain HTML, of each effect its picture, what to look for, and its file's own words."""

import html
import inspect
from collections.abc import Mapping
from types import ModuleType
from typing import Any, Final, get_type_hints

from emulator.plant.physics import flux_map
from emulator.scenario.effects import Effects
from tests.gallery.picture import Picture

_STYLE: Final = """
body { font: 16px/1.5 sans-serif; max-width: 78rem; margin: 2rem auto; padding: 0 1rem; color: #222; }
img { width: 100%; height: auto; }
pre { background: #f5f5f5; padding: 1rem; overflow-x: auto; font-size: 13px; line-height: 1.4; }
nav a { margin-right: 1rem; }
section { border-top: 1px solid #ccc; margin-top: 2rem; }
"""
_INTRODUCTION: Final = """
<p>Every effect that the emulated drive can have, one by one, beside the ideal drive (grey). The motor is the paper's
servo or another of its size; sensors are ideal and nothing is noisy, so that what shows is the effect alone.</p>
<p><em>Voltage that the textbook misses</em>, or the <em>error of u</em>, is the recorded voltage less what R_s, L_d,
L_q and psi_f explain of it: the balance of flux linkages over each control period. It is what a parameter estimate is
left with, or misled by. The <em>order</em> of a line is its frequency over the electrical one; below zero it turns
back.</p>
"""


def module_of(name: str) -> ModuleType:
    """The file in which an effect is told."""
    if name == "flux_map":
        return flux_map
    kinds: dict[str, Any] = get_type_hints(Effects)
    module = inspect.getmodule(kinds[name])
    assert module is not None
    return module


def page(pictures: Mapping[str, Picture]) -> str:
    """The page of pictures by the names of their effects, each in a file of that name."""
    links = "\n".join(f'<a href="#{name}">{html.escape(picture.title)}</a>' for name, picture in pictures.items())
    sections = "\n".join(_section(name, picture) for name, picture in pictures.items())
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>What effects show as</title>\n'
        f"<style>{_STYLE}</style>\n</head>\n<body>\n<h1>What effects show as</h1>\n{_INTRODUCTION}\n"
        f"<nav>{links}</nav>\n{sections}\n</body>\n</html>\n"
    )


def _section(name: str, picture: Picture) -> str:
    module = module_of(name)
    words = html.escape(inspect.cleandoc(module.__doc__ or ""))
    title, file = html.escape(picture.title), module.__name__.replace(".", "/") + ".py"
    return (
        f'<section id="{name}">\n<h2>{title} <small><code>[effects.{name}]</code></small></h2>\n'
        f'<img src="{name}.png" alt="{title}">\n'
        f"<p><strong>Look for:</strong> {html.escape(picture.look)}</p>\n"
        f"<p><strong>Not to be confused:</strong> {html.escape(picture.confused)}</p>\n"
        f"<details><summary>The equations, from <code>{file}</code></summary>\n<pre>{words}</pre></details>\n</section>"
    )
