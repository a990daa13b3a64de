"""Scenarios: what is emulated - motor, drive, run, excitation - built in or from a TOML file.

    [motor]       R_s, L_d, L_q, psi_f, n_p, i_rated, J, B      all at 23.4 degC; or name, see `motors`
    [drive]       see `Drive`
    [run]         see `Run`
    [excitation]  see `Excitation`
    [effects.*]   physics beyond the textbook, see `effects`
    [settings]    parameters that the drive is delivered with, where they are other than the motor's, see `settings`

Keys are the fields below; what has a default may be left out. A scenario that cannot be is refused with one
sentence that names file, key, bound and what came. A winding that warms up within a run, and a bridge with edges:

    [run]
    temperature_profile = [[0.0, 23.4], [1.0, 80.0]]     # points of s and degC, straight lines in between
    [drive]
    bridge = "switched"                                  # or "averaged", which is faster
    timer_counts = 5000

A speed above the base speed that a bench commands, and another excitation; both may be changed by signals:

    [run]
    shaft = "free"
    speed_control = true
    speed_reference = "ramp"                             # or "profile": speed_rpm and what follows it
    [drive]
    field_weakening = true
    [excitation]
    speed_ref = 1600.0                                   # rad/s, electrical
    kind = "multisine"                                   # or "none", "levels", "prbs", "staircase"
"""

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

from emulator.bounds import Bound, Points, PointsBound, ScenarioError, check_bounds, from_table
from emulator.firmware.excitation import FASTEST_SINE, KINDS, MOST_SINES, highest_sine
from emulator.input_file import read_text, shown
from emulator.plant.inverter import longest
from emulator.plant.machine import COLDEST, HOTTEST, TABLE_TEMPERATURES, Machine, at_temperature
from emulator.plant.mechanics import Profile
from emulator.plant.physics.angle_signal import AngleSignal
from emulator.plant.physics.friction import Friction
from emulator.plant.physics.hall import NO_HALL
from emulator.plant.physics.legs import Inverter
from emulator.scenario.effects import NONE, Effects, check_effects, effects_from_table
from emulator.scenario.motors import drive_table, motor_from_table
from emulator.scenario.settings import settings_from_table

SHAFTS = ("dynamometer", "free")
BRIDGES = ("averaged", "switched")
CONTROLS = ("lease", "local", "watchdog")
SAFE_TORQUE_OFF = ("none", "inactive", "active")
FILTERED = "filtered"
RECORDED_SPEEDS = ("angle", FILTERED)
SPEED_REFERENCES = ("profile", "ramp")
_RPM = 2.0 * math.pi / 60.0  # rad/s
_MOST = 1e300
_TEMPERATURE = Bound("degC", low=COLDEST, high=HOTTEST)
_FEWEST_COUNTS = 50
_SEED = Bound(low=0, high=2**63 - 1)


@dataclass(frozen=True, slots=True)
class Drive:
    """The drive. `drive_for` fills in the limits and full scales that suit a motor."""

    i_max: Annotated[float, Bound("A", above=0.0)]  # longest current reference
    adc_full: Annotated[float, Bound("A", above=0.0)]  # the current converter spans -adc_full to +adc_full
    i_full: Annotated[float, Bound("A", above=0.0)]  # full scales of the wire
    u_full: Annotated[float, Bound("V", above=0.0)]
    omega_full: Annotated[float, Bound("rad/s", above=0.0)]
    overvoltage_trip: Annotated[float, Bound("V", low=0.0)]  # of the dc link, switches the bridge off; 0: never
    undervoltage_trip: Annotated[float, Bound("V", low=0.0)]
    i_d_weakening: Annotated[float, Bound("A", low=0.0)]  # most current that field weakening takes
    u_dc: Annotated[float, Bound("V", above=0.0)] = 310.0
    T_s: Annotated[float, Bound("s", low=1e-6, high=1e-2)] = 1e-4  # control period
    bandwidth: Annotated[float, Bound("rad/s", low=10.0, high=1e4)] = 1250.0  # of the current control
    noise_i: Annotated[float, Bound("A", low=0.0)] = 0.01  # standard deviation, each phase current
    adc_bits: Annotated[int, Bound(low=0, high=24)] = 12  # 0: ideal
    current_sensors: Annotated[int, Bound(low=1, high=3)] = 3  # two: i_c = -i_a - i_b; one: a shunt in the dc link
    encoder_counts: Annotated[int, Bound(low=0, high=2**30)] = 0  # per mechanical turn; 0: ideal
    encoder_offset: Annotated[float, Bound("rad", low=-math.pi, high=math.pi)] = 0.0  # mechanical, that it reads when
    # the magnets lie on phase a
    encoder_reversed: bool = False  # it counts down as the motor turns forwards
    phases_crossed: bool = False  # the motor's phases b and c are connected the other way round
    stream_periods: Annotated[int, Bound(low=1, high=1000)] = 10  # control periods per stream row
    sub_steps: Annotated[int, Bound(low=1, high=1000)] = 10  # integration steps per control period, at least
    bridge: str = "averaged"  # the mean voltage over a control period; or "switched": edges
    timer_counts: Annotated[int, Bound(low=0, high=2**24)] = 5000  # per control period, when switched; 0: ideal
    overmodulation: bool = False  # voltages beyond the circle u_dc / sqrt(3) are tried, the legs cut them off
    speed_filter: Annotated[float, Bound("s", low=0.0, high=1.0)] = 1e-3  # time constant of the speed it controls by
    recorded_speed: str = "angle"  # omega_e of recordings is the angle's change over a row; "filtered": that speed
    temperature_trip: Annotated[float, Bound("degC")] = 155.0  # of the winding, switches the bridge off
    speed_error_trip: Annotated[float, Bound("rad/s", low=0.0)] = 0.0  # electrical, and so does this; 0: never
    speed_error_time: Annotated[float, Bound("s", low=0.0, high=10.0)] = 0.1  # when it lasts for longer
    field_weakening: bool = False
    weakening_voltage: Annotated[float, Bound(low=0.5, high=1.0)] = 0.95  # share of the reach that it stays below
    overspeed_trip: Annotated[float, Bound("rad/s", low=0.0)] = 0.0  # electrical; 0: on links 0.9 of the no-load speed,
    # or 1.2 times what the run asks for if that is more; where it runs by itself never
    safe_torque_off: str = "none"  # its input: "inactive", torque is allowed, or "active"
    control: str = "lease"  # on links: it waits for a client's lease; "local": a master inside runs it from the start;
    # "watchdog": a drive of the layout before the lease, in operation from the start, which anybody may write to
    enabled: bool = True  # where it runs by itself: in operation from the start


@dataclass(frozen=True, slots=True)
class Run:
    """What the shaft does, and the temperature.

    The speed rises from `speed_rpm` by `rise_rpm` within `ramp_time` and stays, with a swing on top. A
    dynamometer holds it there; on a free shaft it is where the speed starts and, under speed control after the
    "profile", the reference. After the "ramp" it is `speed_ref` of the excitation that the speed then goes to.

    The winding has `temperature` throughout, or else goes through the points (time in s, degC) of
    `temperature_profile`, linear in between, and stays at the last. R_s, L_d and L_q go with it, period by period.
    """

    shaft: str = "dynamometer"  # or "free"
    speed_rpm: Annotated[float, Bound("rpm")] = 1200.0
    rise_rpm: Annotated[float, Bound("rpm")] = 0.0
    ramp_time: Annotated[float, Bound("s", low=0.0)] = 0.0
    swing_rpm: Annotated[float, Bound("rpm", low=0.0)] = 0.0  # amplitude
    swing_frequency: Annotated[float, Bound("Hz", low=0.0)] = 1.0
    speed_control: bool = False  # free shaft only: i_q follows from a speed loop
    speed_reference: str = "profile"  # or "ramp"
    speed_bandwidth: Annotated[float, Bound("rad/s", above=0.0, high=1000.0)] = 60.0
    tau_L: Annotated[float, Bound("Nm")] = 0.0  # load torque on a free shaft
    temperature: Annotated[float, _TEMPERATURE] = COLDEST
    temperature_profile: Annotated[Points, PointsBound(Bound("s", low=0.0), _TEMPERATURE)] = ()
    seed: Annotated[int, _SEED] = 1


@dataclass(frozen=True, slots=True)
class Excitation:
    """Current and speed references, and the sequences around them: see `emulator.firmware.excitation`."""

    i_d_ref: Annotated[float, Bound("A")] = 0.0
    i_q_ref: Annotated[float, Bound("A")] = 0.0
    i_d_step: Annotated[float, Bound("A", low=0.0)] = 0.0
    i_q_step: Annotated[float, Bound("A", low=0.0)] = 0.0
    step_time: Annotated[float, Bound("s", low=1e-3, high=10.0)] = 5e-3
    kind: str = "levels"
    sine_frequency: Annotated[float, Bound("Hz", low=0.1, high=1e3)] = 10.0  # base of the multisine
    sine_count: Annotated[int, Bound(low=1, high=MOST_SINES)] = 8  # sines an axis
    i_d_levels: Annotated[int, Bound(low=2, high=101)] = 11  # of the staircase
    level_time: Annotated[float, Bound("s", low=1e-3, high=100.0)] = 0.1  # on each of them
    speed_ref: Annotated[float, Bound("rad/s")] = 0.0  # electrical, as what follows
    speed_ramp: Annotated[float, Bound("rad/s2", low=0.0)] = 500.0  # 0: at once
    speed_step: Annotated[float, Bound("rad/s", low=0.0)] = 0.0  # ramps between +- this around the reference
    speed_hold: Annotated[float, Bound("s", low=0.0, high=100.0)] = 0.1  # at either end of these


@dataclass(frozen=True, slots=True)
class Scenario:
    """All of it. `name` stands in the sentences of errors: a file's name, or that of a built-in scenario."""

    name: str
    motor: Machine
    drive: Drive
    run: Run = Run()
    excitation: Excitation = Excitation()
    effects: Effects = NONE
    settings: dict[str, float] = field(default_factory=dict[str, float])  # by signal, where other than they follow

    @property
    def profile(self) -> Profile:
        """The speed over time, rad/s mechanical."""
        run = self.run
        omega_0 = run.speed_rpm * _RPM
        return Profile(omega_0, omega_0 + run.rise_rpm * _RPM, run.ramp_time, run.swing_rpm * _RPM, run.swing_frequency)


def overspeed_of(scenario: Scenario) -> float:
    """Electrical speed (rad/s) beyond which a drive on links switches off."""
    drive, motor = scenario.drive, scenario.motor
    if drive.overspeed_trip > 0.0:
        return drive.overspeed_trip
    asked = motor.n_p * _fastest_rpm(scenario.run, scenario.excitation, motor.n_p) * _RPM
    return max(0.9 * longest(drive.u_dc) / motor.psi_f, 1.2 * asked)


def drive_for(motor: Machine, u_dc: float = 310.0, **given: float | str | bool) -> Drive:
    """A drive whose currents, converter and full scales suit the motor; any field of `Drive` may be given."""
    return from_table(Drive, _suited(motor, {"u_dc": u_dc, **given}), "drive_for: ")


def load(path: Path) -> Scenario:
    """The scenario in a TOML file. Raises ScenarioError."""
    try:
        text = read_text(path)
    except FileNotFoundError:
        raise ScenarioError(f"{path}: no such file; the built-in scenarios are {', '.join(BUILT_IN)}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(f"{path}: cannot be read as text ({getattr(error, 'strerror', None) or error})") from None
    return parse(text, path.name, path.parent)


def parse(text: str, name: str, folder: Path = Path()) -> Scenario:
    """The scenario in a TOML text, called `name` in sentences, whose files are in `folder`. Raises ScenarioError."""
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(f"{name}: is not TOML: {error}") from None
    except (RecursionError, ValueError) as error:  # brackets without end; a number that cannot be
        raise ScenarioError(f"{name}: is not TOML: {type(error).__name__}") from None
    sections = ("motor", "drive", "run", "excitation", "effects", "settings")
    for key, value in document.items():
        if key not in sections:
            raise ScenarioError(f"{name}: {shown(key)} is no section; the sections are {', '.join(sections)}")
        if not isinstance(value, dict):
            raise ScenarioError(f"{name}: {key} takes a section, got {shown(value)}")
    if "motor" not in document:
        raise ScenarioError(f"{name}: the section motor is missing; it has no default")
    motor = motor_from_table(document["motor"], f"{name}: motor.")
    given = drive_table(document["motor"], document.get("drive", {}))
    drive = from_table(Drive, _suited(motor, given), f"{name}: drive.")
    run = from_table(Run, document.get("run", {}), f"{name}: run.")
    excitation = from_table(Excitation, document.get("excitation", {}), f"{name}: excitation.")
    effects = effects_from_table(document.get("effects", {}), f"{name}: effects.", folder)
    settings = settings_from_table(document.get("settings", {}), f"{name}: settings.")
    scenario = Scenario(name, motor, drive, run, excitation, effects, settings)
    check(scenario)
    return scenario


def check(scenario: Scenario) -> None:
    """Raise ScenarioError when a value is out of its bound, or the values cannot be together."""
    name, motor, drive, run, excitation = (
        scenario.name,
        scenario.motor,
        scenario.drive,
        scenario.run,
        scenario.excitation,
    )
    for section, record in (("motor", motor), ("drive", drive), ("run", run), ("excitation", excitation)):
        check_bounds(record, f"{name}: {section}.")

    _check_choices(scenario)
    _check_steps(scenario)
    _check_firmware(name, drive, run, excitation)

    i_d = abs(excitation.i_d_ref) + excitation.i_d_step
    i_q = abs(excitation.i_q_ref) + excitation.i_q_step
    if math.hypot(i_d, i_q) > drive.i_max:
        raise ScenarioError(
            f"{name}: excitation takes references up to drive.i_max = {drive.i_max:g} A, "
            f"got up to {math.hypot(i_d, i_q):.4g} A with the steps"
        )

    rpm = _fastest_rpm(run, excitation, motor.n_p)
    omega_e = motor.n_p * rpm * _RPM
    T_s = drive.T_s
    if omega_e * T_s > 1.0:
        fastest = 1.0 / (T_s * motor.n_p * _RPM)
        raise ScenarioError(
            f"{name}: run.speed_rpm takes at most {fastest:.5g} rpm at T_s = {T_s:g} s, got up to {rpm:g} rpm"
        )
    hot = at_temperature(motor, max((T for _, T in run.temperature_profile), default=run.temperature))
    u = _voltage(hot, omega_e, i_d, i_q)
    if drive.field_weakening:
        u = min(u, _weakened_voltage(hot, drive, omega_e, i_q))
    if u > longest(drive.u_dc):
        lowest = drive.u_dc * u / longest(drive.u_dc)
        raise ScenarioError(
            f"{name}: drive.u_dc takes at least {lowest:.4g} V for {rpm:g} rpm and these currents, got {drive.u_dc:g} V"
        )


def _check_choices(scenario: Scenario) -> None:
    """What cannot be chosen, or not together."""
    name, drive, run = scenario.name, scenario.drive, scenario.run
    if run.shaft not in SHAFTS:
        raise ScenarioError(f"{name}: run.shaft takes {' or '.join(SHAFTS)}, got {run.shaft!r}")
    if drive.bridge not in BRIDGES:
        raise ScenarioError(f"{name}: drive.bridge takes {' or '.join(BRIDGES)}, got {drive.bridge!r}")
    if drive.control not in CONTROLS:
        raise ScenarioError(f"{name}: drive.control takes {' or '.join(CONTROLS)}, got {drive.control!r}")
    if drive.safe_torque_off not in SAFE_TORQUE_OFF:
        raise ScenarioError(
            f"{name}: drive.safe_torque_off takes {' or '.join(SAFE_TORQUE_OFF)}, got {drive.safe_torque_off!r}"
        )
    if drive.recorded_speed not in RECORDED_SPEEDS:
        raise ScenarioError(
            f"{name}: drive.recorded_speed takes {' or '.join(RECORDED_SPEEDS)}, got {drive.recorded_speed!r}"
        )
    if 0 < drive.timer_counts < _FEWEST_COUNTS:
        raise ScenarioError(
            f"{name}: drive.timer_counts takes 0 or at least {_FEWEST_COUNTS}, got {drive.timer_counts}"
        )
    if run.speed_control and run.shaft != "free":
        raise ScenarioError(f"{name}: run.speed_control takes a free shaft, got shaft {run.shaft!r}")

    if scenario.effects.hall.rate != NO_HALL and scenario.effects.angle_signal != AngleSignal():
        raise ScenarioError(f"{name}: expected one way of the angle, effects.hall or effects.angle_signal, got both")
    if run.temperature_profile and run.temperature != COLDEST:
        raise ScenarioError(
            f"{name}: run.temperature takes no value beside run.temperature_profile, got {run.temperature:g}"
        )
    if run.temperature_profile and scenario.effects.thermal.C_w > 0.0:
        raise ScenarioError(f"{name}: run.temperature_profile takes no points beside effects.thermal")
    if drive.overmodulation and drive.bridge != "switched":
        raise ScenarioError(f"{name}: drive.overmodulation takes drive.bridge = 'switched', got {drive.bridge!r}")


def _check_steps(scenario: Scenario) -> None:
    """What is too fast for the control period or the integration's step."""
    name, motor, drive = scenario.name, scenario.motor, scenario.drive
    T_s = drive.T_s
    h, shortest = T_s / drive.sub_steps, min(motor.L_d, motor.L_q) / motor.R_s
    if h > shortest / 2.0:
        raise ScenarioError(
            f"{name}: drive.sub_steps takes steps of at most half the motor's time constant of "
            f"{shortest:g} s, got {h:g} s"
        )
    check_effects(scenario.effects, motor, drive.u_dc, T_s, h, drive.bridge == "switched", f"{name}: effects.")
    if drive.bandwidth * T_s > 0.5:
        raise ScenarioError(
            f"{name}: drive.bandwidth takes at most {0.5 / T_s:g} rad/s at T_s = {T_s:g} s, got {drive.bandwidth:g}"
        )


def _check_firmware(name: str, drive: Drive, run: Run, excitation: Excitation) -> None:
    """Raise ScenarioError when the drive's settings cannot be together."""
    if run.speed_reference not in SPEED_REFERENCES:
        raise ScenarioError(
            f"{name}: run.speed_reference takes {' or '.join(SPEED_REFERENCES)}, got {run.speed_reference!r}"
        )
    if excitation.kind not in KINDS:
        raise ScenarioError(f"{name}: excitation.kind takes {' or '.join(KINDS)}, got {excitation.kind!r}")
    if 0.0 < drive.overvoltage_trip <= drive.undervoltage_trip:
        raise ScenarioError(
            f"{name}: drive.overvoltage_trip takes above drive.undervoltage_trip = {drive.undervoltage_trip:g} V, "
            f"got {drive.overvoltage_trip:g} V"
        )
    if drive.i_d_weakening > drive.i_max:
        raise ScenarioError(
            f"{name}: drive.i_d_weakening takes at most drive.i_max = {drive.i_max:g} A, got {drive.i_d_weakening:g} A"
        )
    highest, most = highest_sine(excitation.sine_frequency, excitation.sine_count), FASTEST_SINE / drive.T_s
    if highest > most:
        raise ScenarioError(
            f"{name}: excitation.sine_frequency takes harmonics up to {most:g} Hz at T_s = {drive.T_s:g} s, "
            f"got up to {highest:g} Hz"
        )


def _fastest_rpm(run: Run, excitation: Excitation, n_p: int) -> float:
    """Highest speed (rpm) of a run."""
    if run.speed_control and run.speed_reference == "ramp":
        return max(abs(run.speed_rpm), (abs(excitation.speed_ref) + excitation.speed_step) / (n_p * _RPM))
    return max(abs(run.speed_rpm), abs(run.speed_rpm + run.rise_rpm)) + run.swing_rpm


def _weakened_voltage(machine: Machine, drive: Drive, omega_e: float, i_q: float) -> float:
    """The voltage (V) with as much field weakening as the drive has, and the i_q (A) that this leaves."""
    i_d = -min(drive.i_d_weakening, machine.psi_f / machine.L_d)
    return _voltage(machine, omega_e, i_d, min(i_q, math.sqrt(drive.i_max**2 - i_d**2)))


def _voltage(machine: Machine, omega_e: float, i_d: float, i_q: float) -> float:
    """The voltage's length (V) at a speed (rad/s) and currents (A), i_q of the sign that needs more."""
    u_d = machine.R_s * abs(i_d) + omega_e * machine.L_q * i_q
    u_q = machine.R_s * i_q + omega_e * (machine.L_d * i_d + machine.psi_f)
    return math.hypot(u_d, u_q)


def _suited(motor: Machine, table: Mapping[str, Any]) -> dict[str, Any]:
    """The drive's table with what is left out taken from the motor."""
    u_dc = table.get("u_dc", 310.0)
    if not isinstance(u_dc, int | float) or not 0.0 < u_dc < _MOST:
        return dict(table)  # its own error comes first
    i_max = table.get("i_max", 2.0 * motor.i_rated)
    return {
        "i_max": i_max,
        "adc_full": 3.0 * motor.i_rated,
        "i_full": 4.0 * motor.i_rated,
        "u_full": 1.25 * u_dc,
        "omega_full": 2.0 * longest(u_dc) / motor.psi_f,  # twice the no-load speed
        "overvoltage_trip": 1.2 * u_dc,
        "undervoltage_trip": 0.6 * u_dc,
        "i_d_weakening": min(motor.i_rated, i_max) if isinstance(i_max, int | float) else motor.i_rated,
        **table,
    }


_PAPER_MOTOR = Machine(R_s=0.9664, L_d=4.24e-3, L_q=6.21e-3, psi_f=0.12, n_p=4, i_rated=6.0)
PAPER = Scenario(
    "paper",
    _PAPER_MOTOR,
    drive_for(_PAPER_MOTOR),
    Run(speed_rpm=1200.0),
    Excitation(i_d_ref=0.0, i_q_ref=2.0, i_d_step=3.0, i_q_step=3.0, step_time=5e-3),
)
"""The paper's motor at 23.4 degC, on a dynamometer, excited so that R_s, L_d, L_q and psi_f can be told."""

PAPER_RUN = Scenario(
    "paper_run",
    _PAPER_MOTOR,
    drive_for(_PAPER_MOTOR, bridge="switched"),
    Run(
        shaft="free",
        speed_rpm=600.0,
        rise_rpm=600.0,
        ramp_time=0.5,
        swing_rpm=60.0,
        swing_frequency=4.0,
        speed_control=True,
        speed_bandwidth=60.0,
        tau_L=1.5,
    ),
    Excitation(i_d_ref=-1.0, i_d_step=2.0, i_q_step=2.0, step_time=2e-3),
)
"""One second of the paper's drive: speed loop, two current loops, space-vector modulation, switched bridge, 10 kHz.

The paper publishes neither sampling period, dc link, magnet flux, inertia, speed nor load. Chosen here: a third of
rated torque, and a speed reference that rises from 600 to 1200 rpm within the first half second, with a swing that
keeps the loop at work to the end. With i_d at zero the paper's windows would tell nothing of L_d, so both axes
step on top, fast enough that even its shortest window of 50 periods sees some steps. The speed loop is PI: on a
free inertia a differential part only adds noise.
"""

_STRETCH = 1.0 / (len(TABLE_TEMPERATURES) - 1)  # s
PAPER_RUN_WARMING = replace(
    PAPER_RUN,
    name="paper_run_warming",
    run=replace(
        PAPER_RUN.run, temperature_profile=tuple((n * _STRETCH, T) for n, T in enumerate(TABLE_TEMPERATURES))
    ),
)
"""The paper's drive with its seven temperatures, evenly spread over the second and in straight lines in between."""

_UNKNOWN_MOTOR = _PAPER_MOTOR._replace(J=8e-4, B=2e-4)
UNKNOWN = Scenario(
    "unknown",
    _UNKNOWN_MOTOR,
    drive_for(
        _UNKNOWN_MOTOR, bridge="switched", encoder_counts=16384, encoder_offset=0.4, encoder_reversed=True,
        enabled=False,
    ),
    Run(shaft="free", speed_control=True, speed_reference="ramp", tau_L=0.02),
    effects=NONE._replace(friction=Friction(coulomb=0.05), inverter=Inverter(dead_time=1.5e-6)),
    settings={
        "n_p": 3.0, "control_R_s": 0.8, "control_L_d": 5e-3, "control_L_q": 5e-3, "control_psi_f": 0.14,
    },
)  # fmt: skip
"""A motor that its drive does not know: other pole pairs and parameters, an encoder that is mounted anywhere and counts
down, a bridge whose dead time nobody makes up for; on a free shaft with friction, to be commissioned.
"""

BUILT_IN = {scenario.name: scenario for scenario in (PAPER, PAPER_RUN, PAPER_RUN_WARMING, UNKNOWN)}
