"""The machine: parameters of the PMSM's voltage equations. Knows nothing of files."""

from dataclasses import dataclass

PARAMETERS: tuple[str, ...] = ("R_s", "L_d", "L_q", "psi_f")
PLAUSIBLE: dict[str, tuple[float, float]] = {
    "R_s": (1e-4, 1e3), "L_d": (1e-7, 1.0), "L_q": (1e-7, 1.0), "psi_f": (1e-5, 100.0),
}
"""Generous, in SI: from a hobby motor's milliohms to a laboratory coil. Outside, a unit is wrong (mH given as H)."""
UNITS: dict[str, str] = {"R_s": "ohm", "L_d": "H", "L_q": "H", "psi_f": "Vs"}


@dataclass(frozen=True, slots=True)
class Machine:
    """Permanent-magnet synchronous machine with constant inductances, per phase, in the rotor frame.

    Amplitude-invariant (peak) dq quantities, d axis on the magnet flux, motor sign convention:

        u_d = R_s i_d + d(psi_d)/dt - omega_e psi_q        psi_d = L_d i_d + psi_f
        u_q = R_s i_q + d(psi_q)/dt + omega_e psi_d        psi_q = L_q i_q
        tau_e = 3/2 n_p (psi_d i_q - psi_q i_d)
    """

    R_s: float  # ohm, stator resistance of a phase
    L_d: float  # H, d-axis inductance
    L_q: float  # H, q-axis inductance
    psi_f: float  # Vs, magnet flux linkage, peak
    n_p: int  # pole pairs
    i_rated: float | None = None  # A, rated phase current, peak
