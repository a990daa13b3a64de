"""The Kalman filter's tuning as a user sets it: three presets, each with settings of its own. Knows nothing of streams.

    tuned    from what a data sheet says: noise_i, lsb, omega_e, doubt, warming
    paper    the published variances
    custom   model, P_0, Q, R, i_min

Settings of a preset that is not in use are kept. See `estimator.online.ekf` for what they mean.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Final, Literal

from pydantic import Field

from bench.expected import CLOSED, Else, Number, Word
from estimator.online import ekf
from estimator.online.ekf import EkfTuning, FilterModel

_MODELS: Final = {"inductances": FilterModel.INDUCTANCES, "fluxes": FilterModel.FLUXES}
_MOST: Final = 1e6  # of a variance, SI
_P_0 = Annotated[float, Number(1e-20, _MOST)]
_Q = Annotated[float, Number(0.0, _MOST)]
_R = Annotated[float, Number(1e-12, _MOST)]
_Current = Annotated[float, Number(1e-6, 1e4, "A")]
_Speed = Annotated[float, Number(0.0, 1e5, "rad/s")]
_FIVE: Final = Else("expected a list of 5 numbers")


@dataclass(frozen=True, slots=True)
class Tuning:
    """The Kalman filter's tuning. Settings of a preset that is not in use are kept."""

    __pydantic_config__: ClassVar = CLOSED

    preset: Annotated[Literal["tuned", "paper", "custom"], Word(), Field(
        description="tuned: from noise_i, lsb, omega_e, doubt, warming; paper: the published variances; "
        "custom: model, P_0, Q, R, i_min"
    )] = "tuned"
    noise_i: Annotated[_Current, Field(description="tuned: noise of a phase current, standard deviation, A")] = 0.01
    lsb: Annotated[float, Number(0.0, 1e4, "A"), Field(description="tuned: resolution of a phase current, A")] = 0.009
    omega_e: Annotated[
        _Speed | None, Field(description="tuned: electrical speed, rad/s; null: the largest of the first 100 rows")
    ] = None
    doubt: Annotated[float, Number(0.01, 1.0), Field(description="tuned: relative deviation of the start values")] = 0.3
    warming: Annotated[
        float, Number(0.0, 1e3, "K/s"), Field(description="tuned: how fast the motor may warm up, K/s")
    ] = 1.0
    model: Annotated[Literal["inductances", "fluxes"], Word(), Field(
        description="custom: states i_d i_q psi_d psi_q R_s, or i_d i_q R_s L_d L_q; a change needs P_0 and Q"
    )] = "fluxes"
    P_0: Annotated[
        tuple[_P_0, _P_0, _P_0, _P_0, _P_0], _FIVE, Field(description="custom: five variances at the start, SI")
    ] = ekf.PAPER.P_0
    Q: Annotated[
        tuple[_Q, _Q, _Q, _Q, _Q], _FIVE, Field(description="custom: five variances per second, SI")
    ] = ekf.PAPER.Q
    R: Annotated[
        tuple[_R, _R], Else("expected a list of 2 numbers"),
        Field(description="custom: variances of sampled i_d, i_q, A^2"),
    ] = ekf.PAPER.R
    i_min: Annotated[_Current, Field(description="custom: a smaller current tells no inductance, A")] = ekf.PAPER.i_min

    @property
    def learns_speed(self) -> bool:
        """The speed is to be taken from the stream."""
        return self.preset == "tuned" and self.omega_e is None

    def for_filter(self, start: Mapping[str, float], omega_e: float, T_s: float) -> EkfTuning:
        """In the estimator's terms, for start values in SI; `omega_e` (rad/s) where the setting leaves it open."""
        if self.preset == "paper":
            return ekf.PAPER
        if self.preset == "tuned":
            return ekf.tuned(
                start["R_s"], start["L_d"], start["L_q"], noise_i=self.noise_i, lsb=self.lsb,
                omega_e=omega_e if self.omega_e is None else self.omega_e, T_s=T_s, doubt=self.doubt,
                warming=self.warming,
            )
        return EkfTuning(self.P_0, self.Q, self.R, self.i_min, _MODELS[self.model])
