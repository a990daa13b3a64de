"""The simulation in place: what it works on stays with the compiled code from step to step; a few numbers come back.

A state is many numbers in many named tuples. To take it apart for the compiled code, and to put it together again, is
as much work as a hundred control periods: it is done where somebody asks for the state, and not with every step.
"""

from typing import Any, Final, NamedTuple, cast

import numpy as np
from numba.core import types
from numba.experimental import structref as numba_structref
from numpy.typing import NDArray

from emulator.drive.simulation import Bench, State, simulated
from emulator.firmware.control import Settings
from emulator.kernel import kernel
from emulator.plant.course import row_at

_structref: Final = cast(Any, numba_structref)


@_structref.register
class _SimulationType(types.StructRef):
    """What numba takes a `Simulation` for."""

    def preprocess_fields(self, fields: Any) -> Any:
        """A field holds any value of its type, be it a constant at first."""
        return tuple((name, cast(Any, types).unliteral(of)) for name, of in fields)


class Simulation(numba_structref.StructRefProxy):
    """What the functions here look into, and change."""

    bench: Bench
    settings: Settings
    state: State


_structref.define_proxy(Simulation, _SimulationType, ["bench", "settings", "state"])


class Now(NamedTuple):
    """What a drive looks at after every step."""

    tick: int  # since power-on
    powered: bool
    trip: int
    omega_e_ref: float  # rad/s, the ramp's
    row_tick: int  # at which the row under way began,
    row_end: int  # or the latest one, if it is complete, ended
    temperature: float  # degC, of the course
    winding: float  # degC, by losses,
    magnet: float
    encoder: float  # rad, mechanical, as it reads


@kernel
def begun(bench: Bench, settings: Settings, state: State) -> Simulation:
    """A simulation from a state on."""
    return Simulation(bench, settings, state)


@kernel
def stepped(
    simulation: Simulation, periods: int, ticks: NDArray[np.int64], rows: NDArray[np.float64],
    recording: NDArray[np.float64],
) -> tuple[Now, int]:
    """Go on by control periods; how many stream rows became complete, see `simulation.simulated`."""
    bench, settings, state = simulation.bench, simulation.settings, simulation.state
    simulation.state, complete = simulated(bench, settings, state, periods, ticks, rows, recording)
    return now_of(simulation), complete


@kernel
def now_of(simulation: Simulation) -> Now:
    """What is to be looked at."""
    state = simulation.state
    row, firmware, heat = state.row, state.firmware, state.heat
    whole = row.taken == row.periods
    return Now(
        state.tick, firmware.powered, firmware.trip, firmware.ramp.omega_e, row.tick,
        row.tick + row.periods if whole else row.tick,
        row_at(simulation.bench.course, state.tick * simulation.bench.fixed.T_s)[0], heat.winding, heat.magnet,
        state.encoder,
    )  # fmt: skip


@kernel
def state_of(simulation: Simulation) -> State:
    """All that changes from period to period."""
    return simulation.state


@kernel
def set_state(simulation: Simulation, state: State) -> None:
    """Go on from another state."""
    simulation.state = state


@kernel
def set_bench(simulation: Simulation, bench: Bench) -> None:
    """Go on with another bench, of the same kind."""
    simulation.bench = bench


@kernel
def set_settings(simulation: Simulation, settings: Settings) -> None:
    """Go on with other settings."""
    simulation.settings = settings
