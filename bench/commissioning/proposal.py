"""The set that a commissioning proposes: what a diagnosis found, what makes up for it, and loops tuned by it."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from bench.commissioning.trial import Reading
from bench.errors import LimitError
from bench.parameters.compensation import electrical_turn
from bench.parameters.from_diagnosis import set_from_diagnosis
from bench.parameters.made import Made
from bench.parameters.parameter_set import OK, Entry
from bench.parameters.tuning import Tuned, speed_loop
from drivers.capture import Capture
from drivers.drive import Identity
from drivers.wire.dictionary import TABLE_SIDE, TABLE_SIZE
from estimator.machine import PARAMETERS, Machine
from estimator.mechanics.mechanics import Mechanics, Told, mechanics
from estimator.online.estimate import Status
from estimator.samples import Resolution, Samples

Column = NDArray[np.float64]
_TAKES_TORQUE: Final = {"iron_loss"}
_SLOW: Final = 1.0  # rad, electrical, that the rotor may turn while the encoder is asked
_AGREE: Final = 0.8  # of the readings
SHARE: Final = 0.2  # of 1/T_s: the current control's bandwidth, where none is asked for
A: Final = 4.0  # of the symmetrical optimum: a phase margin of 62 deg


def from_diagnosis(
    content: Mapping[str, Any], image: Mapping[str, float], identity: Identity, name: str, version: int,
    turn: int | None, temperatures: Mapping[str, float],
) -> Made:  # fmt: skip
    """What a diagnosis (as JSON) found and what makes up for it; `image`: the drive's parameters meanwhile, SI.

    `turn`: see `turn_of`; `temperatures` (degC): of winding and magnets, by signal.
    """
    return set_from_diagnosis(
        content, image, name=name, version=version, T_s=identity.T_s, layout_id=identity.layout_id,
        serial=identity.serial, electrical_turn=turn, temperatures=temperatures,
    )  # fmt: skip


def turn_of(one: Capture, readings: Sequence[Reading], image: Mapping[str, float]) -> int | None:
    """The electrical turn that a recording's first sample is in, by what the encoder read meanwhile; None: not told."""
    theta, turns = np.unwrap(one.columns["theta_e"]), Counter[int]()
    for reading in readings:
        begin, end = reading.begin - one.tick, reading.end - one.tick
        if 0 <= begin <= end < len(theta) and np.ptp(theta[begin : end + 1]) < _SLOW:
            turns[electrical_turn(reading.angle, 0.5 * float(theta[begin] + theta[end]), image)] += 1
    if not turns:
        return None
    turn, count = turns.most_common(1)[0]
    return turn if count >= _AGREE * turns.total() else None


def tuned(made: Made, shaft: Mechanics | None, image: Mapping[str, float], T_s: float, bandwidth: float | None) -> Made:
    """A set with its loops tuned: of a `bandwidth` (rad/s), or `SHARE` of 1/T_s. Raises LimitError."""
    entries, remarks = dict(made.set.entries), list(made.remarks)
    alpha = SHARE / T_s if bandwidth is None else bandwidth
    doubtful = next((e.status for e in entries.values() if e.status != OK), OK)
    if "control_L_q" in entries:
        entries["own_gains"] = Entry(0.0, source="gains follow from the bandwidth and the machine")
        entries["bandwidth"] = Entry(alpha, status=doubtful, source="current control by internal model")
    if shaft is not None and shaft.status is Told.OK and "control_psi_f" in entries:
        for signal, value in speed_gains(shaft, entries["control_psi_f"].value, image, alpha, T_s).values.items():
            entries[signal] = Entry(value, status=doubtful, source=f"speed control by symmetrical optimum, a = {A:g}")
    else:
        why = shaft.sentence if shaft is not None else "the machine is not told"
        remarks.append(f"gains of the speed control are left as they are: J is not told for certain ({why})")
    return Made(replace(made.set, entries=entries), tuple(remarks))


def corrected(
    one: Capture, image: Mapping[str, float], now: Mapping[str, float], turn: int | None = None
) -> Capture:
    """Currents and angle as a drive would have read them by the parameters `now`, not by those of `image`.

    Its sensors' gains and offsets, the angle's offset; where `turn` is known, see `turn_of`, its table as well.
    """
    theta, i = one.columns["theta_e"], one.columns["i_d"] + 1j * one.columns["i_q"]
    fixed = i * np.exp(1j * theta)
    phases = [np.real(fixed * np.exp(-1j * math.tau * k / 3.0)) for k in range(3)]
    channels = "acb" if image["phases_swapped"] else "abc"
    read = [x / image[f"i_{p}_gain"] + image[f"i_{p}_offset"] for x, p in zip(phases, channels, strict=True)]
    a, b, c = (now[f"i_{p}_gain"] * (x - now[f"i_{p}_offset"]) for x, p in zip(read, channels, strict=True))
    theta_now = theta + now["angle_offset"] - image["angle_offset"]
    if turn is not None and now["angle_correction"] and not image["angle_correction"]:
        way = -1.0 if image["angle_reversed"] else 1.0
        places = np.arange(TABLE_SIZE + 1) * math.tau / TABLE_SIZE
        table = [now[f"angle_table_{k % TABLE_SIZE + 1}"] for k in range(TABLE_SIZE + 1)]
        reading = way * (np.unwrap(theta) + turn * math.tau - image["angle_offset"]) / image["n_p"]
        theta_now = theta_now - way * image["n_p"] * np.interp(reading % math.tau, places, table)
    new = (2.0 * a - b - c + 1j * math.sqrt(3.0) * (b - c)) / 3.0 * np.exp(-1j * theta_now)
    return replace(one, columns=one.columns | {"theta_e": theta_now % math.tau, "i_d": new.real, "i_q": new.imag})


def by_torque(one: Capture, values: Mapping[str, float], machine: Machine) -> Capture:
    """With the i_q that makes the torque of a set's tables of flux linkage in a machine whose inductances are constant.

    psi_d i_q - psi_q i_d = (psi_f + (L_d - L_q) i_d) i_q'
    """
    if not values.get("saturation_correction"):
        return one
    d = np.linspace(values["table_i_d_min"], values["table_i_d_max"], TABLE_SIDE)
    q = np.linspace(0.0, values["table_i_q_max"], TABLE_SIDE)
    i_d, i_q = one.columns["i_d"], one.columns["i_q"]

    def flux(table: str) -> Column:
        entries = np.array([values[f"{table}_{k}"] for k in range(1, TABLE_SIZE + 1)]).reshape(TABLE_SIDE, TABLE_SIDE)
        beyond: Any = None  # as at the edge, linear
        return RegularGridInterpolator((d, q), entries, bounds_error=False, fill_value=beyond)((i_d, np.abs(i_q)))

    tau = flux("psi_d_table") * i_q - np.sign(i_q) * flux("psi_q_table") * i_d
    linear = machine.psi_f + (machine.L_d - machine.L_q) * i_d
    return replace(one, columns=one.columns | {"i_q": tau / linear})


def without_losses(shaft: Mechanics, effects: Sequence[str]) -> Mechanics:
    """Friction is doubtful where the iron takes torque as well, which looks like friction."""
    taken = sorted(_TAKES_TORQUE & set(effects))
    if not taken:
        return shaft
    reason = f"{' and '.join(taken)} takes torque as friction does, and is in it"
    estimates = {
        name: one if name == "J" or one.status is not Status.OK else replace(one, status=Status.DOUBTFUL, reason=reason)
        for name, one in shaft.estimates.items()
    }
    return replace(shaft, estimates=estimates, sentence=shaft.sentence or reason)


def speed_gains(shaft: Mechanics, psi_f: float, image: Mapping[str, float], alpha: float, T_s: float) -> Tuned:
    """Of a shaft whose J is told, behind a current control of bandwidth alpha (rad/s). Raises LimitError."""
    J = shaft.estimates["J"].value
    if J is None:
        raise LimitError("J is not told, expected it for the speed control")
    delays = 1.0 / alpha + image["speed_filter"] + 0.5 * T_s
    return speed_loop(J, psi_f, int(image["n_p"]), delays, a=A)


def machine_of(content: Mapping[str, Any], n_p: int) -> tuple[Machine, dict[str, float]] | None:
    """The machine after a diagnosis, and standard errors, SI; None where a parameter is not told."""
    after = content.get("machine", {}).get("after", {})
    values = {name: after.get(name, {}).get("value") for name in PARAMETERS}
    if any(value is None for value in values.values()):
        return None
    std = {name: error for name in PARAMETERS if (error := after[name].get("std")) is not None}
    return Machine(**values, n_p=n_p), std


def shaft_of(captures: Sequence[Capture], machine: Machine, std: Mapping[str, float], theta_step: float) -> Mechanics:
    """Inertia and friction by recordings at full rate; `theta_step` of the encoder, rad electrical, 0: not known."""
    runs = [
        Samples(
            *(one.columns[name] for name in ("theta_e", "omega_e", "i_d", "i_q", "u_d", "u_q")), T_s=one.T_s,
            t0=float(one.t[0]), resolution=Resolution(theta_e=theta_step),
        ) for one in captures
    ]  # fmt: skip
    return mechanics(runs, machine, std)
