"""A measured flux map: current as a function of flux linkage, from tabled points of both.

The points (i_d, i_q) -> (psi_d, psi_q) of a file are turned into one energy function w, a bicubic spline over flux
linkages whose gradient is the current:

    i_d = d(w)/d(psi_d)        i_q = d(w)/d(psi_q)

so the relation is reciprocal, as a field's must be, whatever the measurement's errors; what the points lose by it is
`misfit`. The machine is taken to be symmetric in i_q. C. de Boor, "A Practical Guide to Splines", 2001, chapter 17.

Outside the points the outermost cells go on as they are.
"""

import math
from pathlib import Path
from typing import NamedTuple
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from emulator.input_file import check_regular
from emulator.kernel import kernel

_ARRAYS = ("i_s_dq", "psi_s_dq")  # of a file
_LARGEST = 20_000_000  # bytes of a file
_FEWEST_CELLS, _MOST_CELLS = 10, 20  # per axis, in between half as many as a square of the points has on a side
_SMOOTH = 1e-3  # weight of the spline's third differences against the points

Matrix = NDArray[np.float64]


class FluxMap(NamedTuple):
    """A spline of energy; none where it has no coefficients."""

    d_0: float  # Vs, where the first cell begins
    q_0: float
    d_step: float  # Vs, size of a cell
    q_step: float
    w: Matrix  # (cells + 3) x (cells + 3), Vs A, the same for either sign of psi_q
    psi_f: float  # Vs, flux linkage without current


NO_MAP = FluxMap(0.0, 0.0, 1.0, 1.0, np.empty((0, 0)), 0.0)


@kernel
def _weights(x: float) -> tuple[float, float, float, float]:
    """The four cubic B-splines that reach into a cell, at a place 0 to 1 in it."""
    y = 1.0 - x
    return (
        y * y * y / 6.0,
        (3.0 * x * x * x - 6.0 * x * x + 4.0) / 6.0,
        (3.0 * y * y * y - 6.0 * y * y + 4.0) / 6.0,
        x * x * x / 6.0,
    )


@kernel
def _slopes(x: float) -> tuple[float, float, float, float]:
    """Their derivatives."""
    y = 1.0 - x
    return -0.5 * y * y, 1.5 * x * x - 2.0 * x, -1.5 * y * y + 2.0 * y, 0.5 * x * x


@kernel
def _cell(psi: float, start: float, step: float, cells: int) -> tuple[int, float]:
    x = (psi - start) / step
    n = min(max(math.floor(x), 0), cells - 1)
    return n, x - n


@kernel
def gradient(flux_map: FluxMap, psi: complex) -> complex:
    """Current i_dq (A) at a flux linkage (Vs)."""
    w = flux_map.w
    n, x = _cell(psi.real, flux_map.d_0, flux_map.d_step, w.shape[0] - 3)
    m, y = _cell(psi.imag, flux_map.q_0, flux_map.q_step, w.shape[1] - 3)
    a, a_x, b, b_y = _weights(x), _slopes(x), _weights(y), _slopes(y)
    i_d = i_q = 0.0
    for k in range(4):
        row = w[n + k, m] * b[0] + w[n + k, m + 1] * b[1] + w[n + k, m + 2] * b[2] + w[n + k, m + 3] * b[3]
        row_y = w[n + k, m] * b_y[0] + w[n + k, m + 1] * b_y[1] + w[n + k, m + 2] * b_y[2] + w[n + k, m + 3] * b_y[3]
        i_d += a_x[k] * row
        i_q += a[k] * row_y
    return complex(i_d / flux_map.d_step, i_q / flux_map.q_step)


@kernel
def energy(flux_map: FluxMap, psi: complex) -> float:
    """w (Vs A) at a flux linkage (Vs)."""
    w = flux_map.w
    n, x = _cell(psi.real, flux_map.d_0, flux_map.d_step, w.shape[0] - 3)
    m, y = _cell(psi.imag, flux_map.q_0, flux_map.q_step, w.shape[1] - 3)
    a, b = _weights(x), _weights(y)
    total = 0.0
    for k in range(4):
        for j in range(4):
            total += a[k] * b[j] * w[n + k, m + j]
    return total


def loaded(path: Path) -> FluxMap:
    """The map in an .npz file of complex arrays `i_s_dq` (A) and `psi_s_dq` (Vs), peak values.

    Raises ValueError in a sentence where the file is none, or where current does not follow from flux.
    """
    try:
        check_regular(path, _LARGEST)
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            columns = {name: np.asarray(file[name], complex).ravel() for name in _ARRAYS if name in file}
    except FileNotFoundError:
        raise ValueError(f"no such file: {path}") from None
    except (OSError, EOFError, ValueError, TypeError, BadZipFile) as error:
        raise ValueError(f"{path.name} is no .npz file of numbers ({error})") from None
    missing = [name for name in _ARRAYS if name not in columns]
    if missing:
        raise ValueError(f"{path.name} takes the arrays {' and '.join(_ARRAYS)}, {missing[0]} is missing")
    i, psi = (columns[name] for name in _ARRAYS)
    if i.shape != psi.shape or len(i) < 16 or not bool(np.all(np.isfinite(i) & np.isfinite(psi))):
        raise ValueError(
            f"{path.name} takes at least 16 finite points, as many of current as of flux, got {len(i)} and {len(psi)}"
        )
    return fitted(i, psi)


def fitted(i: NDArray[np.complex128], psi: NDArray[np.complex128]) -> FluxMap:
    """The map through points of current (A) and flux linkage (Vs). Raises ValueError where it cannot be inverted."""
    reach = float(np.abs(psi.imag).max())
    low, high = np.array([psi.real.min(), -reach]), np.array([psi.real.max(), reach])
    if not bool(np.all(high > low)):
        raise ValueError("a flux map takes points that differ on both axes")
    cells = min(max(math.isqrt(len(psi)) // 2, _FEWEST_CELLS), _MOST_CELLS)
    step = (high - low) / cells
    side = cells + 3
    rows_d, rows_q = np.zeros((len(psi), side, side)), np.zeros((len(psi), side, side))
    for n, point in enumerate(psi):
        c, x = _cell(point.real, low[0], step[0], cells)
        m, y = _cell(point.imag, low[1], step[1], cells)
        rows_d[n, c : c + 4, m : m + 4] = np.outer(_slopes(x), _weights(y)) / step[0]
        rows_q[n, c : c + 4, m : m + 4] = np.outer(_weights(x), _slopes(y)) / step[1]
    third = np.diff(np.eye(side), 3, axis=0)
    smooth = np.concatenate([np.kron(third, np.eye(side)), np.kron(np.eye(side), third)])
    points = np.concatenate([rows_d.reshape(len(psi), -1), rows_q.reshape(len(psi), -1)])
    smooth *= _SMOOTH * float(np.abs(points).max())
    half = (side + 1) // 2
    mirrored = np.kron(np.eye(side), np.eye(half)[[min(m, side - 1 - m) for m in range(side)]])
    system = np.concatenate([points, smooth]) @ mirrored
    v, *_ = np.linalg.lstsq(system, np.concatenate([i.real, i.imag, np.zeros(len(smooth))]), rcond=None)
    w = np.array((mirrored @ v).reshape(side, side), np.float64)
    flux_map = FluxMap(float(low[0]), float(low[1]), float(step[0]), float(step[1]), w, 0.0)
    _check_invertible(flux_map, psi)
    return flux_map._replace(psi_f=without_current(flux_map, psi[np.argmin(np.abs(i))].real))


def without_current(flux_map: FluxMap, near: float) -> float:
    """psi_d (Vs) where no current flows, by Newton's method from a value near it."""
    psi = near
    for _ in range(50):
        slope = hessian(flux_map, complex(psi, 0.0))[0]
        step = gradient(flux_map, complex(psi, 0.0)).real / slope
        psi -= step
        if abs(step) < 1e-14:
            break
    return float(psi)


def hessian(flux_map: FluxMap, psi: complex) -> tuple[float, float, float]:
    """d(i_d)/d(psi_d), d(i_q)/d(psi_q) and d(i_d)/d(psi_q) (1/H), by central differences."""
    d, q = 1e-4 * flux_map.d_step, 1e-4 * flux_map.q_step
    by_d = (gradient(flux_map, psi + d) - gradient(flux_map, psi - d)) / (2.0 * d)
    by_q = (gradient(flux_map, psi + 1j * q) - gradient(flux_map, psi - 1j * q)) / (2.0 * q)
    return by_d.real, by_q.imag, by_q.real


def misfit(flux_map: FluxMap, i: NDArray[np.complex128], psi: NDArray[np.complex128]) -> float:
    """Root-mean-square distance (A) of the map's currents from the points'."""
    told = np.array([gradient(flux_map, complex(point)) for point in psi.ravel()])
    return float(np.sqrt(np.mean(np.abs(told - i.ravel()) ** 2)))


def _check_invertible(flux_map: FluxMap, psi: NDArray[np.complex128]) -> None:
    for point in psi:
        dd, qq, dq = hessian(flux_map, complex(point))
        if not (dd > 0.0 and dd * qq > dq * dq):
            raise ValueError(
                "a flux map takes inductances above zero everywhere, so that current follows from flux; "
                f"this one has none at psi_d = {point.real:.4g} Vs, psi_q = {point.imag:.4g} Vs"
            )
