"""Phase resistance imbalance: phases a, b, c have R_s (1 + share) each, the star point floating.

As space vectors, with a = exp(j 120 deg):

    u_R = R_0 i + R_2 conj(i)      R_0 = R_s (1 + mean share)      R_2 = R_s (share_a + a^2 share_b + a^4 share_c) / 3

Shows as a voltage that turns backwards: twice the electrical frequency in the rotor frame, in proportion to current.
P. C. Krause et al., "Analysis of Electric Machinery and Drive Systems", 3rd ed., 2013, chapter 3.
"""

from typing import Annotated, NamedTuple

from emulator.bounds import Bound
from emulator.kernel import kernel

_SHARE = Bound(low=-0.5, high=2.0)
_A2, _A4 = complex(-0.5, -(3.0**0.5) / 2.0), complex(-0.5, 3.0**0.5 / 2.0)


class Imbalance(NamedTuple):
    """Sizes: by how much a phase's resistance differs, as a share of R_s."""

    a: Annotated[float, _SHARE] = 0.0
    b: Annotated[float, _SHARE] = 0.0
    c: Annotated[float, _SHARE] = 0.0


@kernel
def drop(imbalance: Imbalance, R_s: float, i: complex) -> complex:
    """Voltage (V) over the windings' resistance at a stationary current (A)."""
    a, b, c = imbalance
    R_2 = R_s / 3.0 * (a + b * _A2 + c * _A4)
    return R_s * (1.0 + (a + b + c) / 3.0) * i + R_2 * i.conjugate()


@kernel
def share_of(imbalance: Imbalance, phase: int) -> float:
    """The share of a phase: 0, 1, 2 for a, b, c."""
    return imbalance.a if phase == 0 else imbalance.b if phase == 1 else imbalance.c


@kernel
def axis_of(phase: int) -> complex:
    """Direction of a phase's winding, 0, 1, 2 for a, b, c, in the stationary frame."""
    return 1.0 + 0j if phase == 0 else _A4 if phase == 1 else _A2
