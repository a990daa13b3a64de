"""Figures 2 to 8 as PNG files. Draws what it is given."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.typing import RcKeyType

from tests.paper.published import NAMES, UNITS, Array
from tests.paper.runs import Run

_SCALE = {"ohm": 1.0, "mH": 1e3}
_STYLE: Final[dict[RcKeyType, Any]] = {
    "font.size": 10, "axes.grid": True, "grid.alpha": 0.3, "axes.spines.top": False, "axes.spines.right": False,
}


def windows(path: Path, title: str, parameter: int, run: Run, tracks: Mapping[str, Array], spread: float) -> None:
    """One parameter under several windows, from when each is full; `spread` (relative) beyond the truth is cut off."""
    name = NAMES[parameter]
    with mpl.rc_context(_STYLE):
        figure = Figure((8.0, 4.6), layout="constrained")
        axes = figure.add_subplot()
        colours = mpl.colormaps["viridis"](np.linspace(0.95, 0.1, len(tracks)))
        scale = _SCALE[UNITS[name]]
        for (label, track), colour in zip(tracks.items(), colours, strict=True):
            axes.plot(run.t, track[:, parameter] * scale, color=colour, lw=1.1, label=label)
        true = run.truth[:, parameter] * scale
        axes.plot(run.t, true, color="crimson", lw=1.6, ls="--", label="true", zorder=5)
        axes.set(
            title=title, xlabel="time in s", ylabel=f"{name} in {UNITS[name]}", xlim=(0.0, 1.0),
            ylim=(true.min() * (1.0 - spread), true.max() * (1.0 + spread)),
        )
        axes.ticklabel_format(useOffset=False)
        figure.legend(loc="outside right center", title="window,\nrows of 0.1 ms", frameon=False)
        _save(figure, path)


def methods(path: Path, title: str, run: Run, tracks: Mapping[str, Array], spread: Array) -> None:
    """All parameters, one above the other, under several methods."""
    with mpl.rc_context(_STYLE):
        figure = Figure((9.0, 8.0), layout="constrained")
        figure.suptitle(title)
        panes = figure.subplots(3, 1, sharex=True)
        for parameter, (name, axes) in enumerate(zip(NAMES, panes, strict=True)):
            scale = _SCALE[UNITS[name]]
            true = run.truth[:, parameter] * scale
            for n, (label, track) in enumerate(tracks.items()):
                line = "." if "published" in label else "-"  # one that jumps from look to look is shown as dots
                axes.plot(run.t, track[:, parameter] * scale, line, color=f"C{n}", lw=1.2, ms=4, label=label)
            axes.plot(run.t, true, color="black", lw=1.4, ls="--", label="true", zorder=5)
            axes.set(
                ylabel=f"{name} in {UNITS[name]}", xlim=(0.0, 1.0),
                ylim=(true.min() * (1.0 - spread[parameter]), true.max() * (1.0 + spread[parameter])),
            )
        panes[-1].set_xlabel("time in s")
        figure.legend(*panes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
        _save(figure, path)


def _save(figure: Figure, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=130)
