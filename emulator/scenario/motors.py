"""The catalogue: twelve motors from 50 W to 50 kW, with the numbers that were published of them.

Every number is one a source states, or is converted from one as told beside it. What a source does not state and had to
be chosen is marked `chosen`; what follows from others, `computed`. Knows nothing of drives, runs and effects.

    [motor]
    name = "teknic_m2310p"      # of `MOTORS`; gives every key of the section ...
    R_s = 0.5                   # ... and any of them may be given anew

The machine's numbers are per phase of a star, in peak values. Data sheets state others:

    resistance, inductance between two terminals    half of it is a phase's
    current rms                                     times sqrt(2)
    K_e, V peak between two terminals per 1000 rpm  psi_f = K_e / (sqrt(3) n_p 2 pi 1000/60); rms: times sqrt(2)
    flux in V/Hz, peak, phase to star point         psi_f = flux / (2 pi)
    K_t, Nm per A peak                              psi_f = K_t / (3/2 n_p); per A rms: that / sqrt(2)
    inertia in oz in s2                             times 7.0616e-3 kg m2

Where two sources of one motor differ, the data sheet's number is taken. Friction that is not published is zero.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from emulator.bounds import ScenarioError, from_table
from emulator.input_file import shown
from emulator.plant.machine import Machine

TOLERANCE: Final = 0.1
"""By how much a motor may differ from its data: "+/- 10 %", Kollmorgen, AKMH motors, instruction manual, section on
terms. The sources below state none of their own."""

_RMS: Final = math.sqrt(2.0)  # peak of a sine of rms 1
_LINE: Final = math.sqrt(3.0)  # between terminals, of a phase's 1
_KRPM: Final = 2.0 * math.pi * 1000.0 / 60.0  # rad/s
_OZ_IN_S2: Final = 7.0616e-3  # kg m2


@dataclass(frozen=True, slots=True)
class Motor:
    """A motor as published, and what suits it."""

    title: str
    source: str
    machine: Machine
    P_rated: float  # W, at the shaft
    speed_rpm: float  # rated
    u_dc: float  # V
    T_s: float = 5e-5  # s, chosen: control period


def motor_from_table(table: Mapping[str, object], where: str) -> Machine:
    """The machine of a section [motor]: the catalogue's of that `name`, with what else is given instead.

    `where` is put before the key in every sentence: `file.toml: motor.`. Raises ScenarioError.
    """
    given = {key: value for key, value in table.items() if key != "name"}
    motor = _named(table, where)
    return from_table(Machine, (motor.machine._asdict() if motor else {}) | given, where)


def drive_table(motor: Mapping[str, object], drive: Mapping[str, object]) -> dict[str, object]:
    """The section [drive], with the dc link and the control period that suit the motor named in the section [motor]."""
    named = MOTORS.get(str(motor.get("name")))
    return ({"u_dc": named.u_dc, "T_s": named.T_s} if named else {}) | dict(drive)


def _named(table: Mapping[str, object], where: str) -> Motor | None:
    if "name" not in table:
        return None
    name = table["name"]
    if not isinstance(name, str):
        raise ScenarioError(f"{where}name takes a text, got {shown(name)}")
    if name not in MOTORS:
        raise ScenarioError(f"{where}name takes a motor of the catalogue, {', '.join(MOTORS)}; got {shown(name)}")
    return MOTORS[name]


MOTORS: Final[dict[str, Motor]] = {
    "anaheim_bly172s": Motor(
        "Anaheim Automation BLY172S-24V-4000, 42 mm",
        "Anaheim Automation, BLY17 series product sheet L010228 (power, speed, voltage, R, L, J); Texas Instruments, "
        "MotorWare user.h, Anaheim_BLY172S (flux); MathWorks, mcb_SetPMSMMotorParameters, BLY172S (current, B)",
        Machine(
            R_s=0.80 / 2,  # 0.80 ohm between terminals
            L_d=1.20e-3 / 2,  # 1.20 mH between terminals, one number for both axes
            L_q=1.20e-3 / 2,
            psi_f=0.03416 / (2.0 * math.pi),  # 0.03416 V/Hz
            n_p=4,
            i_rated=3.5,  # stated as peak
            J=0.00068 * _OZ_IN_S2,
            B=9.6037e-6,
        ),
        P_rated=53.0,
        speed_rpm=4000.0,
        u_dc=24.0,
    ),
    "teknic_m2310p": Motor(
        "Teknic M-2310P-LN-04K, NEMA 23",
        "Teknic, Industrial-Grade NEMA 23 Motors, N23_Industrial_Grade_Motors_v6.3 (R, L, K_e, J, voltage, speed, "
        "power); MathWorks, mcb_SetPMSMMotorParameters, Teknic2310P (current, B)",
        Machine(
            R_s=0.72 / 2,  # 0.72 ohm between terminals
            L_d=0.40e-3 / 2,  # 0.40 mH between terminals, one number for both axes
            L_q=0.40e-3 / 2,
            psi_f=4.64 / (_LINE * 4 * _KRPM),  # 4.64 V peak between terminals per 1000 rpm
            n_p=4,
            i_rated=7.1,  # stated as peak
            J=0.001 * _OZ_IN_S2,
            B=2.6369e-6,
        ),
        P_rated=170.0,
        speed_rpm=6000.0,
        u_dc=40.0,
    ),
    "beckhoff_am8141": Motor(
        "Beckhoff AM8141-0J00, identified",
        "UltraZohm, ultrazohm_sw, uz_pmsm/beckhoff_AM8141-0j00-000, flux map measured at 800 rpm (R, L, psi, n_p, "
        "current, speed, voltage), and its desk bench's configuration of the same motor (J)",
        Machine(
            R_s=0.51,  # per phase
            L_d=1.75e-3,
            L_q=1.75e-3,
            psi_f=0.042,  # peak: 20.77 V rms between terminals at 1000 rpm are also stated, 0.0405 Vs
            n_p=4,
            i_rated=8.0,
            J=1.08e-4,
            B=0.0,
        ),
        P_rated=211.0,  # computed: torque of the rated current, at rated speed
        speed_rpm=1000.0,
        u_dc=48.0,
        T_s=1e-4,
    ),
    "mini_cheetah": Motor(
        "MIT Mini Cheetah actuator's outrunner, without its gear",
        "B. Katz, driver firmware on os.mbed.com, Config/motor_config.h before revision 55 (R, L, flux, n_p, thermal "
        "resistance); MIT Biomimetics, Cheetah-Software, the Mini Cheetah's model (J of the rotor, 24 V)",
        Machine(
            R_s=0.13,  # per phase
            L_d=20e-6,  # per phase, one number for both axes
            L_q=20e-6,
            psi_f=0.0025,  # stated in Wb; K_t of 0.08 Nm per A peak is 3/2 n_p times it
            n_p=21,
            i_rated=15.0,  # chosen: 44 W of copper loss, 55 K over the 1.25 K/W that are stated
            J=63e-6,
            B=0.0,
        ),
        P_rated=247.0,  # computed: torque of the rated current, at rated speed
        speed_rpm=2000.0,  # chosen: four fifths of the no-load speed at 24 V
        u_dc=24.0,
    ),
    "hbl48zl400": Motor(
        "HBL48ZL400330K, 48 V servo of 8 pole pairs",
        "gmp_pro (github.com/javnson), motor_preset/HBL48ZL400330K.h, from its data sheet",
        Machine(
            R_s=0.4 / 2,  # 0.4 ohm between terminals
            L_d=0.6e-3 / 2,  # 0.6 mH between terminals, one number for both axes
            L_q=0.6e-3 / 2,
            # 10.5 V per 1000 rpm. The preset's comment says phase to star point; only rms between terminals gives the
            # rated torque of 1.27 Nm at 11 A
            psi_f=10.5 * _RMS / (_LINE * 8 * _KRPM),
            n_p=8,
            i_rated=11.0,  # stated as peak
            J=0.45e-4,
            B=0.55e-3,
        ),
        P_rated=400.0,
        speed_rpm=3000.0,
        u_dc=48.0,
    ),
    "servo_4nm": Motor(
        "Servo motor of 4 Nm at 3000 rpm",
        "Adaptive two-stage extended Kalman filter theory in application of sensorless control for permanent magnet "
        "synchronous motor, Mathematical Problems in Engineering, 2013, doi 10.1155/2013/974974, table 1",
        Machine(
            R_s=0.525,
            L_d=1.65e-3,
            L_q=1.65e-3,
            psi_f=0.0744,
            n_p=4,
            i_rated=4.0 / (1.5 * 4 * 0.0744),  # computed: of the nominal torque
            J=0.54e-3,
            B=0.0,
        ),
        P_rated=1257.0,  # computed: nominal torque at nominal speed
        speed_rpm=3000.0,
        u_dc=310.0,  # chosen: rectified 230 V
        T_s=1e-4,
    ),
    "aalto_2k2": Motor(
        "2.2 kW interior magnet motor of Aalto University",
        "H. A. A. Awan, doctoral dissertation 187/2019, Aalto University, table 6.2, and with others, IEEE Trans. "
        "Industry Applications, 2018, doi 10.1109/TIA.2018.2862410; numbers as in motulator's example 2.2-kW PMSM",
        Machine(
            R_s=3.6,
            L_d=36e-3,
            L_q=51e-3,
            psi_f=0.545,
            n_p=3,
            i_rated=4.3 * _RMS,  # 4.3 A rms
            J=0.015,  # with the load machine
            B=0.0,
        ),
        P_rated=2200.0,
        speed_rpm=1500.0,  # 75 Hz
        u_dc=540.0,
        T_s=1e-4,
    ),
    "baldor_ecs101m": Motor(
        "Baldor ECS101M0H7EF4, magnet-assisted reluctance motor, 5.5 kW",
        "motulator, example 5.5-kW PM-SyRM, its magnetically linear model and ratings; flux maps of the same motor: "
        "Lelli and others, TechRxiv, 2024, doi 10.36227/techrxiv.171332345.53790692",
        Machine(
            R_s=0.63,
            L_d=18e-3,
            L_q=110e-3,
            psi_f=0.47,
            n_p=2,
            i_rated=8.8 * _RMS,  # 8.8 A rms
            J=0.015,
            B=0.0,
        ),
        P_rated=5500.0,
        speed_rpm=1800.0,  # 60 Hz
        u_dc=540.0,
        T_s=1e-4,
    ),
    "amk_dd5": Motor(
        "AMK DD5-14-10-POW, wheel motor of racing cars",
        "AMK, data sheet DD5-14-10-POW: 0.135 ohm between terminals, 18.8 V rms per 1000 rpm, 0.274e-3 kg m2, 41 A "
        "rms, 350 V rms, 9.8 Nm, 12.3 kW, 12000 rpm",
        Machine(
            R_s=0.135 / 2,
            # The sheet prints L_d 0.24 and L_q 0.12 mH; its torque curves fit them exchanged, as such a rotor has it
            L_d=0.12e-3,
            L_q=0.24e-3,
            psi_f=18.8 * _RMS / (_LINE * 5 * _KRPM),  # between terminals
            n_p=5,
            i_rated=41.0 * _RMS,
            J=2.74e-4,
            B=0.0,
        ),
        P_rated=12.3e3,
        speed_rpm=12000.0,
        u_dc=350.0 * _RMS,  # computed: the dc link of 350 V rms between terminals
    ),
    "pmsynrm_15k": Motor(
        "15 kW magnet-assisted reluctance motor of Zhejiang University",
        "M. Lin, Zhejiang University, in gmp_pro (github.com/javnson), motor_preset/PMSRM_4P_15KW520V.h",
        Machine(
            R_s=0.1215,
            L_d=3.03e-3,
            L_q=20.19e-3,
            psi_f=0.44,
            n_p=2,
            i_rated=32.09,  # stated as peak
            J=0.018,
            B=0.0,
        ),
        P_rated=15e3,
        speed_rpm=3000.0,
        u_dc=500.0 * _RMS,  # computed: the dc link of the rated voltage
        T_s=1e-4,
    ),
    "emrax_208_hv": Motor(
        "EMRAX 208 HV, axial flux, 10 pole pairs",
        "EMRAX 208 technical data, high-voltage winding, as in a public gym-electric-motor example (emrax_208_HV)",
        Machine(
            R_s=12e-3,
            L_d=125e-6,
            L_q=130e-6,
            psi_f=39.3e-3,
            n_p=10,
            i_rated=141.0,  # stated as peak
            J=23e-3,
            B=0.0,
        ),
        P_rated=26.1e3,  # computed: torque of the nominal current, at nominal speed
        speed_rpm=3000.0,
        u_dc=400.0,
    ),
    "lea_52k": Motor(
        "52 kW traction motor of Paderborn University",
        "A. Brosch, S. Hanke, O. Wallscheid, J. Boecker, IEEE Trans. Power Electronics, 2020, "
        "doi 10.1109/TPEL.2020.3006779, and S. Hanke, O. Wallscheid, J. Boecker, IEMDC, 2019, "
        "doi 10.1109/IEMDC.2019.8785122; numbers as in gym-electric-motor's PermanentMagnetSynchronousMotor",
        Machine(
            R_s=18e-3,
            L_d=0.37e-3,
            L_q=1.2e-3,
            psi_f=66e-3,
            n_p=3,
            i_rated=240.0,  # stated as peak
            J=0.03883,
            B=0.0,
        ),
        P_rated=52e3,
        speed_rpm=3000.0,
        u_dc=300.0,
        T_s=1e-4,
    ),
}
"""By name, the smallest first."""
