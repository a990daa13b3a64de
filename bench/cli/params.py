"""`pmsm-bench params`: what its subcommands take."""

from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

params = typer.Typer(
    no_args_is_help=True, add_completion=False,
    help="A drive's parameters as files: read, planned, flashed, verified, taken back.",
)

Drive = Annotated[str, Argument(metavar="URL|NAME", help="the drive, by its bus, or as the running service calls it")]
Service = Annotated[
    str | None,
    Option(metavar="URL", help="of a NAME: the service (default http://127.0.0.1:8080, or PMSM_BENCH_PORT)"),
]
Set = Annotated[Path, Argument(metavar="SET.toml", help="a parameter set")]
Json = Annotated[bool, Option("--json", help="as JSON, SI")]
Out = Annotated[Path, Option(metavar="FILE", help="where to write it; - for standard output")]


@params.command()
def pull(
    drive: Drive, out: Out = Path("-"), name: Annotated[str, Option(help="of the set")] = "as it is",
    service: Service = None,
) -> None:
    """Read all of a drive's parameters into a set."""
    from bench.cli.commands.params import pulled

    pulled(drive, service, out, name)


@params.command()
def show(given: Set, json: Json = False) -> None:
    """What a set holds, and all that is wrong with it."""
    from bench.cli.commands.params import shown

    shown(given, as_json=json)


@params.command()
def diff(
    given: Set, other: Annotated[str, Argument(metavar="SET.toml|URL|NAME", help="another set, or a drive")],
    service: Service = None,
) -> None:
    """Where a set and another, or a drive, differ: exit code 1."""
    from bench.cli.commands.params import differences

    raise typer.Exit(differences(given, other, service))


@params.command()
def plan(given: Set, drive: Drive, json: Json = False, service: Service = None) -> None:
    """What a set would change in a drive, and all that forbids it; nothing is written."""
    from bench.cli.commands.params import planned

    raise typer.Exit(planned(given, drive, service, as_json=json))


@params.command()
def flash(
    given: Set,
    drive: Drive,
    yes: Annotated[bool, Option("--yes", help="do not ask")] = False,
    override: Annotated[str, Option(metavar="REASON", help="why doubts do not forbid it; goes into the history")] = "",
    service: Service = None,
) -> None:
    """Write, read back, store, reset, read again; anything but equality is rolled back."""
    from bench.cli.commands.params import flashed

    raise typer.Exit(flashed(given, drive, service, override, ask=not yes))


@params.command()
def verify(given: Set, drive: Drive, service: Service = None) -> None:
    """Whether a drive has the values of a set: exit code 1 where it does not."""
    from bench.cli.commands.params import differences

    raise typer.Exit(differences(given, drive, service, of_drive=True))


@params.command()
def rollback(
    drive: Drive,
    before: Annotated[
        str | None,
        Option(metavar="TIME", help="of an earlier one that was flashed, as `params history` prints it "
                                    "(2026-01-31T12:00:00Z), or a beginning that no other one has"),
    ] = None,
    yes: Annotated[bool, Option("--yes", help="do not ask")] = False,
    service: Service = None,
) -> None:  # fmt: skip
    """Flash all values that a drive had before the latest flash from here, or before an earlier one."""
    from bench.cli.commands.params import rolled_back

    raise typer.Exit(rolled_back(drive, service, before, ask=not yes))


@params.command()
def resume(
    drive: Drive,
    finish: Annotated[bool, Option("--finish/--roll-back", help="go on to the new values, or back to those before")],
    service: Service = None,
) -> None:
    """Finish a flash that was cut, or roll it back."""
    from bench.cli.commands.params import resumed

    raise typer.Exit(resumed(drive, service, finish=finish))


@params.command()
def history(drive: Drive, json: Json = False, service: Service = None) -> None:
    """What was flashed into a drive from here, by the TIME that `rollback --before` takes, and one that was cut."""
    from bench.cli.commands.params import past

    past(drive, service, as_json=json)


@params.command()
def export(
    given: Set,
    form: Annotated[str, Option(metavar="dcf|c|a2l|json", help="CANopen tools, a C header, calibration tools, JSON")],
    out: Out = Path("-"),
    kind: Annotated[str, Option("--type", metavar="float|q15|q31|iq24", help="of numbers in C")] = "float",
    prefix: Annotated[str, Option(help="of all names in C, for firmware with more than one motor")] = "pmsm",
) -> None:
    """Write a set for other tools."""
    from bench.cli.commands.params import exported

    exported(given, form, kind, prefix, out)


@params.command("import")
def import_(
    dcf: Annotated[Path, Argument(metavar="FILE.dcf", help="a device configuration file")],
    out: Out = Path("-"),
    name: Annotated[str, Option(help="of the set")] = "",
) -> None:
    """Make a set of a DCF."""
    from bench.cli.commands.params import imported

    imported(dcf, out, name or dcf.stem[:60])


Name = Annotated[str, Option(help="of the set (default: what it is from)")]
Version = Annotated[int, Option(min=1, help="of the set")]
Bandwidth = Annotated[
    float | None, Option(metavar="RAD/S", help="of the current control (default: the fastest there is)")
]
Period = Annotated[float | None, Option("--T-s", metavar="S", help="control period, where nothing else tells it")]


@params.command("from-diagnosis")
def from_diagnosis(
    diagnosis: Annotated[Path, Argument(metavar="FILE.json", help="as `diagnose --json` and the service give it")],
    drive: Annotated[
        str | None, Option(metavar="URL", help="the drive, its parameters as they were while it was recorded")
    ] = None,
    image: Annotated[Path | None, Option(metavar="SET.toml", help="these, as `params pull` wrote them then")] = None,
    out: Out = Path("-"),
    name: Name = "",
    version: Version = 1,
    own_gains: Annotated[bool, Option("--own-gains", help="and gains of the current control")] = False,
    bandwidth: Bandwidth = None,
    T_s: Period = None,
    electrical_turn: Annotated[
        int | None,
        Option(metavar="K", min=0, help="electrical turn of the encoder's in which the recording began, from 0: an "
                                        "eccentric encoder's table needs it"),
    ] = None,
) -> None:
    """Make a set of a diagnosis: the machine, and what makes up for each effect; what nothing does is told.

    Exit code: 0, there is a set; 2, wrong use or wrong input; 3, the diagnosis tells no value, and nothing is written.
    """
    from bench.cli.commands.params_made import Gains, diagnosed

    gains = Gains(own_gains, bandwidth, T_s)
    raise typer.Exit(diagnosed(diagnosis, drive, image, out, name, version, gains, electrical_turn))


@params.command("from-estimates")
def from_estimates(
    estimates: Annotated[
        Path, Argument(metavar="FILE.json", help="as `replay --json`, `estimates --json` and the service give them")
    ],
    drive: Annotated[
        str | None, Option(metavar="URL", help="the drive, for its temperatures now where the file does not tell")
    ] = None,
    out: Out = Path("-"),
    name: Name = "",
    version: Version = 1,
    temp_winding: Annotated[float | None, Option(metavar="DEGC", help="where neither tells")] = None,
    temp_magnet: Annotated[float | None, Option(metavar="DEGC", help="likewise")] = None,
    magnets: Annotated[
        float | None, Option(metavar="1/K", help="change of the magnets' flux (default: -0.0011, typical of NdFeB)")
    ] = None,
) -> None:
    """Make a set of estimates, with what R_s and psi_f are at 20 degC.

    Exit code: 0, there is a set; 2, wrong use or wrong input; 3, no estimate has a value, and nothing is written.
    """
    from bench.cli.commands.params_made import estimated

    given = {"temp_winding": temp_winding, "temp_magnet": temp_magnet}
    temperatures = {key: value for key, value in given.items() if value is not None}
    raise typer.Exit(estimated(estimates, drive, out, name, version, temperatures, magnets))


@params.command()
def tune(
    given: Set,
    drive: Annotated[str | None, Option(metavar="URL", help="the drive, for what the set does not hold")] = None,
    out: Out = Path("-"),
    bandwidth: Bandwidth = None,
    J: Annotated[
        float | None, Option("--J", metavar="KG_M2", help="inertia with its load: gains of the speed control, too")
    ] = None,
    a: Annotated[float, Option("--a", help="speed control: the larger, the slower and the better damped")] = 2.0,
    T_s: Period = None,
) -> None:
    """Add gains by rule to a set, for the machine that it holds, and say what they promise."""
    from bench.cli.commands.params_made import tuned

    tuned(given, drive, out, bandwidth, T_s, J, a)
