"""A picture of an effect: a few panels side by side, drawn alike everywhere."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.typing import RcKeyType

from tests.emulator.plant.physics.effect_runs import Column, Recording, Vectors

IDEAL: Final = "0.55"  # colour of the drive without the effect
D, Q, A, B = "C0", "C3", "C2", "C1"  # colours of axes d and q, of phase a or alpha, and of what is second to it
_STYLE: Final[dict[RcKeyType, Any]] = {
    "font.size": 9, "axes.grid": True, "grid.alpha": 0.3, "axes.spines.top": False, "axes.spines.right": False,
    "axes.titlesize": 10, "legend.frameon": False, "legend.fontsize": 8, "lines.linewidth": 1.2,
}  # fmt: skip


@dataclass(frozen=True)
class Picture:
    """What shows an effect best. `draw` fills the panels."""

    title: str
    look: str  # what to look for
    confused: str  # what it can be taken for, and what tells them apart
    draw: Callable[[Sequence[Axes]], None]
    panels: int = 3


def save(picture: Picture, path: Path) -> None:
    """Draw it into a PNG file."""
    with mpl.rc_context(_STYLE):
        figure = Figure((4.3 * picture.panels, 3.7), layout="constrained")
        picture.draw([figure.add_subplot(1, picture.panels, n + 1) for n in range(picture.panels)])
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=110, metadata={"Software": None})


def label(axes: Axes, title: str, x: str, y: str, *, legend: Literal["best", "upper right"] = "best") -> None:
    """Title, axes with their units, legend."""
    axes.set(title=title, xlabel=x, ylabel=y)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc=legend)


def degrees(r: Recording) -> Column:
    """Electrical angle, unwrapped from its first turn on."""
    theta = np.unwrap(r["theta_e"])
    return np.degrees(theta - 2.0 * np.pi * np.floor(theta[0] / (2.0 * np.pi) + 1e-9))


def orders(x: Vectors | Column, theta: Column, most: int) -> Column:
    """Amplitudes of exp(j k theta) in x, k from -most to most; over whole turns."""
    ks = np.arange(-most, most + 1)
    return np.array([abs(np.mean(x * np.exp(-1j * k * theta))) for k in ks])


def bars(axes: Axes, ideal: Vectors | Column, real: Vectors | Column, theta: Column, most: int, unit: str) -> None:
    """Spectra over the electrical angle, ideal and with the effect, without what stands still."""
    ks = np.arange(-most, most + 1)
    shown = ks != 0
    axes.bar(ks[shown] - 0.2, orders(ideal, theta, most)[shown], 0.4, color=IDEAL, label="ideal")
    axes.bar(ks[shown] + 0.2, orders(real, theta, most)[shown], 0.4, color=Q, label="with the effect")
    axes.set_xlim(-most - 0.7, most + 0.7)
    label(axes, "Spectrum in the rotor frame", "order of the electrical frequency", f"amplitude in {unit}")


def dq(axes: Axes, x: Column, ideal: Vectors, real: Vectors, letter: str) -> None:
    """Both axes of a vector over x, ideal and with the effect."""
    axes.plot(x, ideal.real, color=IDEAL, lw=0.9, label="ideal")
    axes.plot(x, ideal.imag, color=IDEAL, lw=0.9)
    axes.plot(x, real.real, color=D, label=f"{letter}_d")
    axes.plot(x, real.imag, color=Q, label=f"{letter}_q")


def ms(r: Recording) -> Column:
    """Time in ms since the first row."""
    return 1e3 * (r["t"] - r["t"][0])
