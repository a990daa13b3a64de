"""The magnets' temperature follows something outside: psi_f falls, or falls and rises.

    psi_f(t) = psi_f (1 + share(t))        share: see `temperature_course`

psi_f is that at the start; with saturation beside it, see `saturation`. NdFeB loses 0.11 % of its flux per kelvin:
J. R. Hendershot, T. J. E. Miller, "Design of Brushless Permanent-Magnet Machines", 2010, chapter 15. Magnets that warm
up once, see `magnet_flux_drift`, have fewer sizes and are named where they explain as much.
"""

from estimator.physics.magnet_flux import TEMPERATURE
from estimator.physics.saturation import FluxChange
from estimator.physics.temperature_course import parameters_of, shapes, told_as

EFFECT = FluxChange(
    TEMPERATURE, "a course of the magnets' temperature",
    parameters_of(0.03, -0.3, 0.1),
    shapes,
    "back-EMF that moves with time at the same speed",
    ("magnet_flux_drift", "magnet_flux_step", "winding_temperature"),
    told=told_as("change", "Vs", lambda rows: rows.machine.psi_f),
    in_proportion_to="psi_f",
    other_form_of="magnet_flux_drift",
    discrepancy=1.5e-3,
)
