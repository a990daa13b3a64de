"""The comparison as a PNG file. Draws what it is given."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.typing import RcKeyType

from tests.peers.cases import Course

_UNITS: Final = {"i_d": "A", "i_q": "A", "tau_e": "Nm", "omega_m": "rad/s"}
_STYLE: Final[dict[RcKeyType, Any]] = {
    "font.size": 9, "axes.grid": True, "grid.alpha": 0.3, "axes.spines.top": False, "axes.spines.right": False,
}


def compared(path: Path, courses: Sequence[tuple[str, Course, Course, Mapping[str, float]]]) -> None:
    """Signals of both sides, and below each its difference; a column for each title, ours, theirs and rms errors."""
    with mpl.rc_context(_STYLE):
        figure = Figure((4.6 * len(courses), 11.0), layout="constrained")
        ratios = [3.0, 1.0] * len(_UNITS)
        panes = figure.subplots(2 * len(_UNITS), len(courses), sharex=True, squeeze=False, height_ratios=ratios)
        for column, (title, ours, theirs, errors) in enumerate(courses):
            panes[0, column].set_title(title.replace(", ", ",\n", 1))
            pairs = zip(ours.signals().items(), theirs.signals().values(), strict=True)
            for row, ((name, a), b) in enumerate(pairs):
                above, below = panes[2 * row, column], panes[2 * row + 1, column]
                above.plot(theirs.t, b, color="tab:orange", lw=2.2, label="motulator")
                above.plot(ours.t, a, color="tab:blue", lw=0.8, label="ours")
                above.set_ylabel(f"{name} in {_UNITS[name]}")
                below.plot(ours.t, a - b, color="black", lw=0.6)
                below.set_ylabel("difference")
                below.set_title(f"rms {errors[name]:.2g} %", loc="right", fontsize=8, pad=2)
            panes[-1, column].set_xlabel("time in s")
        figure.legend(*panes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=2, frameon=False)
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=110)
