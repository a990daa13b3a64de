"""Thermal: winding, magnets and housing warm up by the losses; R_s and psi_f follow.

    C_w dT_w/dt = P_copper - (T_w - T_h) / R_wh
    C_m dT_m/dt = -(T_m - T_h) / R_mh
    C_h dT_h/dt = P_iron + (T_w - T_h) / R_wh + (T_m - T_h) / R_mh - (T_h - T_ambient) / R_ha
    R_s = R_s0 (1 + alpha (T_w - 23.4 degC))        psi_f = psi_f0 (1 + beta (T_m - 23.4 degC))

A lumped network as in J. R. Hendershot, T. J. E. Miller, "Design of Brushless Permanent-Magnet Machines",
2010. The temperatures move by explicit steps of one control period, which is short against every time constant.

Shows as R_s that drifts up and psi_f that drifts down, each with its own time constant.
"""

from typing import Annotated, NamedTuple

from emulator.bounds import Bound
from emulator.kernel import kernel

REFERENCE = 23.4  # degC, at which motors are told
_HEAT = Bound("J/K", low=0.0)
_RESISTANCE = Bound("K/W", above=0.0)


class Thermal(NamedTuple):
    """Sizes; none where C_w is zero."""

    C_w: Annotated[float, _HEAT] = 0.0  # winding
    C_m: Annotated[float, Bound("J/K", above=0.0)] = 100.0  # magnets
    C_h: Annotated[float, Bound("J/K", above=0.0)] = 1000.0  # housing
    R_wh: Annotated[float, _RESISTANCE] = 0.5  # winding to housing
    R_mh: Annotated[float, _RESISTANCE] = 2.0  # magnets to housing
    R_ha: Annotated[float, _RESISTANCE] = 1.0  # housing to ambient
    ambient: Annotated[float, Bound("degC", low=-40.0, high=80.0)] = REFERENCE
    alpha: Annotated[float, Bound("1/K", low=0.0, high=0.01)] = 0.00393  # copper
    beta: Annotated[float, Bound("1/K", low=-0.01, high=0.0)] = -0.0011  # NdFeB


class Temperatures(NamedTuple):
    """Of the nodes, in degC."""

    winding: float
    magnet: float
    housing: float


@kernel
def warmed(thermal: Thermal, T: Temperatures, W_copper: float, W_iron: float, h: float) -> Temperatures:
    """The temperatures after a time h (s) in which so much energy (J) turned to heat."""
    winding_housing = (T.winding - T.housing) / thermal.R_wh
    magnet_housing = (T.magnet - T.housing) / thermal.R_mh
    housing_ambient = (T.housing - thermal.ambient) / thermal.R_ha
    return Temperatures(
        T.winding + (W_copper - h * winding_housing) / thermal.C_w,
        T.magnet - h * magnet_housing / thermal.C_m,
        T.housing + (W_iron + h * (winding_housing + magnet_housing - housing_ambient)) / thermal.C_h,
    )


@kernel
def resistance_factor(thermal: Thermal, T: Temperatures) -> float:
    """R_s over that at 23.4 degC."""
    return 1.0 + thermal.alpha * (T.winding - REFERENCE)


@kernel
def flux_factor(thermal: Thermal, T: Temperatures) -> float:
    """psi_f over that at 23.4 degC; magnets that are too hot have none."""
    return max(1.0 + thermal.beta * (T.magnet - REFERENCE), 0.0)
