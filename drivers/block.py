"""A block: consecutive rows of a drive's stream in SI units, without a gap inside."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

Column = NDArray[np.float64]

COLUMNS: Final = ("tick", "theta_e", "omega_e", "i_d", "i_q", "u_d", "u_q", "i_d_mean", "i_q_mean", "u_dc")


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Consecutive stream rows, columns of equal length n (float64, SI, peak dq, electrical angles in rad).

    Row k covers `periods` control periods from `tick[k]` on: `theta_e i_d i_q` are sampled at its start, the
    other columns are means over it, in the rotor frame at each period's middle. Clock: the drive's ticks.
    """

    tick: NDArray[np.int64]  # control periods since the drive's reset, at the row's start
    theta_e: Column  # rad, 0 to 2 pi
    omega_e: Column  # rad/s
    i_d: Column  # A
    i_q: Column  # A
    u_d: Column  # V
    u_q: Column  # V
    i_d_mean: Column  # A
    i_q_mean: Column  # A
    u_dc: Column  # V
    T_s: float  # s, control period
    periods: int  # control periods per row
    lost_before: int  # rows lost between the block before and this one; 0 where they join
    i_step: float  # A, size of a count of the currents
    u_step: float  # V, of the voltages
    temp_winding: float  # degC, latest; NaN while the drive has told none
    temp_magnet: float  # degC, latest

    def __len__(self) -> int:
        return len(self.tick)

    @property
    def end(self) -> int:
        """Tick at the last row's end."""
        return int(self.tick[-1]) + self.periods

    def joins(self, before: "Block") -> bool:
        """It goes on with the rows of another, of the same length and resolution, without a gap."""
        same = (self.periods, self.T_s, self.i_step, self.u_step) == (
            before.periods, before.T_s, before.i_step, before.u_step
        )
        return same and not self.lost_before and int(self.tick[0]) == before.end


def one_of(blocks: Sequence[Block]) -> Block:
    """Blocks of which each joins the one before, as one."""
    if len(blocks) == 1:
        return blocks[0]
    last = blocks[-1]
    columns = {name: np.concatenate([getattr(block, name) for block in blocks]) for name in COLUMNS}
    return replace(last, **columns, lost_before=blocks[0].lost_before)
