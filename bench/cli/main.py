"""`pmsm-bench`: one console script. A refusal is a sentence on standard error, one for each thing that is wrong; what
exit codes mean stands in `exit_codes`.
"""

import errno
import os
import sys
import traceback
from pathlib import Path
from typing import Annotated, NoReturn

import typer
from typer import Argument, Option

from bench.cli.exit_codes import EPILOG, FAULT, INTERRUPTED, REFUSED, details_kept
from bench.cli.params import params
from bench.cli.recordings import recordings
from bench.errors import BenchError, ConfigError, InternalError, LimitError
from drivers.errors import DriveError

app = typer.Typer(
    name="pmsm-bench", no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False, epilog=EPILOG,
    help="Hardware-in-the-loop bench for permanent-magnet synchronous motor drives.",
)

app.add_typer(recordings, name="recordings")
app.add_typer(params, name="params")

DEFAULT_BUS = "canopen://socketcand/127.0.0.1:29536/can0/5"
_NO_OUTPUT = (errno.EPIPE, errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)

At = Annotated[
    str | None,
    Option(metavar="URL", help=f"where the emulated drive is (default {DEFAULT_BUS}, its port beside the service's)"),
]
Port = Annotated[int | None, Option(help="port of the service (default 8080, or PMSM_BENCH_PORT)")]
Service = Annotated[
    str | None, Option(metavar="URL", help="the service (default http://127.0.0.1:8080, or PMSM_BENCH_PORT)")
]
Scenario = Annotated[str, Option(metavar="NAME|FILE.toml", help="what to emulate")]
Drive = Argument(help="the drive, as the service calls it")
Bus = Annotated[str | None, Option(metavar="URL", help="a drive by its bus, without a service")]
Recording = Annotated[Path, Argument(help="recording: CSV, CSV.gz, Parquet, .mat or .mf4")]
_COLUMNS = "columns called otherwise; also COLUMN[UNIT], COLUMN*NUMBER"
Columns = Annotated[list[str] | None, Option("--map", metavar="NAME=COLUMN,...", help=_COLUMNS)]
Constants = Annotated[list[str] | None, Option("--set", metavar="NAME=VALUE,...", help="values in place of columns")]
AsJson = Annotated[bool, Option("--json", help="as one JSON document, SI")]
_ALIGN = "the voltage in row k was applied ROWS later"
Align = Annotated[list[str] | None, Option(metavar="u=ROWS", help=_ALIGN)]
Witnesses = Annotated[
    list[str] | None,
    Option(metavar="psi_f=2.478e-3+-1%", help="a value measured elsewhere, with its error (95 %); may be repeated"),
]  # fmt: skip


def _version(asked: bool) -> None:
    """Print version, Python and platform, and end."""
    if asked:
        from bench.cli.doctor.machine import version_line

        print(version_line())
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, Option("--version", callback=_version, is_eager=True, help="version, Python and platform in a line")
    ] = False,
) -> None:
    """Hardware-in-the-loop bench for permanent-magnet synchronous motor drives."""
    del version  # told by its callback


@app.command()
def serve(config: Annotated[Path, Option(help="drives and ports, TOML")], port: Port = None) -> None:
    """Run the service over the drives of a configuration file, until Ctrl-C."""
    from bench.cli.commands.run import run_service
    from bench.config import load_config

    run_service(load_config(config), port)


@app.command()
def token(
    new: Annotated[bool, Option("--new", help="make another one: that before counts no longer")] = False,
    config: Annotated[Path | None, Option(help="the service's configuration, if it names another file")] = None,
) -> None:
    """Print the token that a service beyond loopback asks for; it is made where there is none."""
    from bench.config import load_config
    from bench.files import token_file
    from bench.service.token import made, renewed

    path = token_file() if config is None else load_config(config).token
    print(renewed(path) if new else made(path))


@app.command()
def emulate(
    at: Annotated[
        list[str] | None,
        Option(metavar="URL", help=f"where the drive is; may be repeated: on several at once ({DEFAULT_BUS})"),
    ] = None,
    scenario: Scenario = "paper",
    fault: Annotated[
        list[str] | None, Option(metavar="FAULT", help="what befalls its links, as lose=0.01@5+2; repeatable")
    ] = None,
    fault_script: Annotated[str | None, Option(metavar="FILE", help="such faults, one a line")] = None,
    control: Annotated[
        str | None,
        Option(metavar="lease|local|watchdog", help="who starts it: a client with its lease (default), a master "
                                                    "inside it, or anybody, as before there were leases"),
    ] = None,
) -> None:
    """Run an emulated drive, in real time, until Ctrl-C."""
    from bench.cli.commands.run import run_emulator

    faults = [part for text in fault or () for part in ("--fault", text)]
    script = ["--fault-script", fault_script] if fault_script is not None else []
    who = ["--control", control] if control is not None else []
    raise typer.Exit(run_emulator(at or [DEFAULT_BUS], scenario, faults + script + who))


@app.command()
def up(at: At = None, scenario: Scenario = "paper", port: Port = None) -> None:
    """Run an emulated drive and the service over it, until Ctrl-C ends both; another pair by another --port."""
    from bench.cli.commands.run import run_both

    run_both(at, scenario, port)


@app.command()
def eds(
    out: Annotated[Path | None, Option(metavar="FILE", help="write it there (default: standard output)")] = None,
) -> None:
    """Print the drive's electronic data sheet for CANopen tools."""
    from drivers.wire.canopen_od import eds as data_sheet

    _written(data_sheet(), out)


@app.command()
def estimates(
    name: Annotated[str, Argument(help="the drive")],
    service: Service = None,
    once: Annotated[bool, Option("--once", help="print one table and end")] = False,
    as_json: AsJson = False,
) -> None:
    """Show a drive's live estimates as a table, until Ctrl-C.

    Exit code of --once: 0, estimates are ok; 1, the equations do not fit; 2, no service, no drive; 3, none can be told.
    """
    from bench.cli.commands.live import show

    raise typer.Exit(show(name, service, once=once, as_json=as_json))


@app.command()
def signals(
    name: Annotated[str, Drive],
    given: Annotated[
        list[str] | None, Argument(metavar="SIGNAL[=VALUE]...", help="to read, to write (SI); none: all are read")
    ] = None,
    service: Service = None,
    as_json: AsJson = False,
) -> None:
    """Read or write a drive's signals: references, excitation, limits, commands."""
    from bench.cli.commands.signals import show

    show(name, given or [], service, as_json=as_json)


@app.command()
def start(
    name: Annotated[str, Drive],
    given: Annotated[
        list[str] | None, Argument(metavar="SETPOINT=VALUE...", help="set points (SI), such as i_q_ref=2")
    ] = None,
    service: Service = None,
    as_json: AsJson = False,
) -> None:
    """Start a drive: the service takes control of it, gives set points and switches its bridge on."""
    from bench.cli.commands.control import start as start_drive

    start_drive(name, given or [], service, as_json=as_json)


@app.command()
def stop(name: Annotated[str, Drive], service: Service = None, as_json: AsJson = False) -> None:
    """Stop a drive, whoever controls it: bridge off, set points zero. A stop by software is no safety function."""
    from bench.cli.commands.control import stop as stop_drive

    stop_drive(name, service, as_json=as_json)


@app.command()
def reset(name: Annotated[str, Drive], service: Service = None, as_json: AsJson = False) -> None:
    """Reset a drive's fault; its bridge stays off."""
    from bench.cli.commands.control import reset as reset_drive

    reset_drive(name, service, as_json=as_json)


@app.command()
def capture(
    name: Annotated[str | None, Drive] = None,
    signals: Annotated[
        str | None, Option(metavar="i_d,i_q,...", help="what to record (default: what an estimation rests on)")
    ] = None,
    length: Annotated[int | None, Option(metavar="N", help="samples, up to 65536 (default: 10000)")] = None,
    decimation: Annotated[
        int | None, Option(metavar="D", help="control periods per sample (default: 1, as estimations need it)")
    ] = None,
    pre_trigger: Annotated[
        float | None, Option(metavar="SHARE", help="of the samples, from before the trigger (default: 0)")
    ] = None,
    trigger: Annotated[
        str | None, Option(metavar="now|command|i_q>2.0", help="what starts it; levels in SI (default: now)")
    ] = None,
    timeout: Annotated[float | None, Option(metavar="S", help="for the trigger to come (default: 60)")] = None,
    out: Annotated[Path | None, Option(metavar="FILE.parquet", help="default: named by drive and time")] = None,
    service: Service = None,
    drive: Bus = None,
) -> None:
    """Record with a drive's own recorder, every control period, into a file for `replay`. Ctrl-C cancels it."""
    from bench.cli.commands.capture import by_service, directly

    asked = {
        "signals": None if signals is None else [part.strip() for part in signals.split(",")], "length": length,
        "decimation": decimation, "pre_trigger": pre_trigger, "trigger": trigger, "timeout_s": timeout,
    }
    given = {key: value for key, value in asked.items() if value is not None}
    _check_one(name, drive, service)
    if name is not None:
        by_service(name, service, given, out)
    elif drive is not None:
        directly(drive, given, out)


@app.command()
def replay(
    file: Recording,
    nominal: Annotated[Path | None, Option(metavar="MACHINE.toml", help="values held, or started from")] = None,
    mapping: Columns = None,
    constants: Constants = None,
    align: Annotated[list[str] | None, Option(metavar="u=ROWS", help=f"{_ALIGN} (fractions allowed)")] = None,
    method: Annotated[
        str | None, Option(metavar="wls|rls|ekf", help="window (default), recursive least squares, Kalman filter")
    ] = None,
    window: Annotated[
        str | None, Option(metavar="N|auto", help="wls: samples (default: all, up to a million), or chosen by the data")
    ] = None,
    longest: Annotated[
        int | None, Option(metavar="N", help="--window auto: samples to choose from (default: 10000)")
    ] = None,
    periods: Annotated[int | None, Option(help="wls, rls: periods per regression row (default: 1)")] = None,
    forgetting_factor: Annotated[
        float | None, Option(metavar="LAM", help="rls: 0.99 to 1 (default: 1, nothing is forgotten)")
    ] = None,
    ekf: Annotated[
        str | None,
        Option(metavar="tuned|paper|FILE.toml", help="ekf: tuning (default: tuned); start values by --nominal"),
    ] = None,
    estimate: Annotated[str | None, Option(metavar="R_s,L_q", help="what to estimate (default: all)")] = None,
    witness: Witnesses = None,
    every: Annotated[int | None, Option(help="rows between two lines of the CSV (default: window/10)")] = None,
    json_out: Annotated[
        Path | None, Option("--json", metavar="OUT", help="result as JSON; -: in place of the table")
    ] = None,
    csv_out: Annotated[Path | None, Option("--csv", metavar="OUT", help="estimates over time")] = None,
) -> None:
    """Run the streaming estimator over a recording, and say whether its equations fit.

    Exit code: 0, they do; 1, they do not; 2, the file cannot be read or replayed; 3, nothing can be told.
    """
    from bench.cli.commands.files.replay import Options, run
    from bench.witness import witnesses_of

    options = Options(method, window, longest, periods, forgetting_factor, ekf, estimate, witnesses_of(witness or ()))
    raise typer.Exit(run(file, nominal, mapping, constants, align, options, every, json_out, csv_out))


@app.command()
def mechanics(
    file: Recording,
    machine: Annotated[
        Path, Option(metavar="MACHINE.toml", help="psi_f, n_p, and L_d, L_q, encoder_counts where they are known")
    ],
    trust: Annotated[
        list[str] | None, Option(metavar="psi_f=2%,...", help="how far off these may be (default: exact)")
    ] = None,
    mapping: Columns = None,
    constants: Constants = None,
    as_json: AsJson = False,
) -> None:
    """Say what a recording's accelerations tell of the shaft: moment of inertia, friction, load torque.

    Voltages are not needed. Exit code: 0, told; 1, the equation of motion does not fit; 2, the file cannot be read; 3,
    nothing can be told, as of a shaft that does not accelerate.
    """
    from bench.cli.commands.files.mechanics import run
    from bench.diagnoses.diagnosis_request import trust_of
    from bench.recordings.column_options import columns_of

    mapped, held, _ = columns_of(mapping, constants, None)
    raise typer.Exit(run(file, machine, trust_of(trust or ()), mapped, held, as_json=as_json))


@app.command()
def diagnose(
    files: Annotated[list[Path], Argument(metavar="FILE...", help="recordings, or tables of steady points")],
    nominal: Annotated[
        Path | None,
        Option(metavar="MACHINE.toml", help="the machine; a folder, or a name with {stem}: one each, by name; "
                                            "steady points and recordings at standstill do without"),
    ] = None,
    kind: Annotated[
        str, Option("--format", metavar="NAME", help="auto, recording, points, moteus-ld, lea-thermal, servo-sine or "
                                                     "servo-pulses")
    ] = "auto",
    trust: Annotated[
        list[str] | None, Option(metavar="R_s=20%,...", help="how far off a nominal value may be (10 % each)")
    ] = None,
    witness: Witnesses = None,
    json_out: Annotated[
        str | None,
        Option("--json", metavar="OUT", help="as JSON; of several recordings a folder, or a name with {stem}; -: "
                                             "in place of words"),
    ] = None,
    report: Annotated[str | None, Option(metavar="OUT.html", help="as a page; likewise")] = None,
    machine: Annotated[str | None, Option(metavar="OUT.toml", help="the machine with its effects; likewise")] = None,
    together: Annotated[
        bool,
        Option("--together", help="all recordings, of one machine, in one diagnosis: what they share, what differs; "
                                  "outputs and --nominal are then one file each"),
    ] = False,
    jobs: Annotated[int | None, Option(metavar="N", help="recordings at a time (default: one per core)")] = None,
    mapping: Columns = None,
    constants: Constants = None,
    align: Align = None,
    force: Annotated[bool, Option("--force", help="write over files that are there")] = False,
    fail_on: Annotated[
        str, Option("--fail-on", metavar="unexplained|explained", help="explained: a named effect fails, too")
    ] = "unexplained",
) -> None:
    """Say what physics recordings show that a machine's data leave out: where, what, how big, how sure.

    Exit code: 0, no mismatch or explained; 1, something stays unexplained; 2, a file cannot be read, diagnosed or
    written; 3, the recording cannot tell. Of several files the worst, in the order 70, 2, 1, 3, 0; with --together that
    of all as one.
    """
    from bench.cli.commands.files import diagnose, diagnose_together
    from bench.cli.commands.files.diagnosing import Options
    from bench.diagnoses.diagnosis_request import trust_of
    from bench.diagnoses.formats import checked_format
    from bench.recordings.column_options import columns_of
    from bench.witness import witnesses_of

    options = Options(
        trust_of(trust or ()), *columns_of(mapping, constants, align), checked_format(kind), jobs, force, fail_on,
        witnesses_of(witness or ()),
    )
    outputs = {"--json": json_out, "--report": report, "--machine": machine}
    run = diagnose_together.run if together else diagnose.run
    raise typer.Exit(run(files, nominal, outputs, options))


@app.command()
def simulate(
    file: Recording,
    machine: Annotated[Path, Option(metavar="MACHINE.toml", help="as `diagnose --machine` writes it")],
    out: Annotated[Path | None, Option(metavar="OUT.parquet", help="simulated currents, a new file")] = None,
    mapping: Columns = None,
    constants: Constants = None,
    align: Align = None,
    as_json: AsJson = False,
) -> None:
    """Simulate a recording's currents by a machine with the effects of its file, and say how far off they are."""
    from bench.cli.commands.files.simulate import run
    from bench.recordings.column_options import columns_of

    run(file, machine, *columns_of(mapping, constants, align), out, as_json=as_json)


@app.command()
def experiment(
    diagnosis: Annotated[Path, Argument(metavar="DIAGNOSIS.json", help="as `diagnose --json` writes it")],
    name: Annotated[str | None, Drive] = None,
    ambiguity: Annotated[
        int | None, Option(metavar="N", help="which of its ambiguities, from 1 (default: the first that can be)")
    ] = None,
    out: Annotated[Path, Option(metavar="FILE.parquet", help="the recording")] = Path("experiment.parquet"),
    service: Service = None,
    drive: Bus = None,
    i_max: Annotated[
        float | None, Option(metavar="A", help="--drive: longest current (default: the diagnosed motor's rating)")
    ] = None,
) -> None:
    """Do on a drive what a diagnosis asks for, record it for the next `diagnose`, and stop the drive. Ctrl-C stops it.

    The currents are held one after the other; the speed as well where the drive controls it.
    """
    from bench.cli.commands.experiment import by_service, directly

    _check_one(name, drive, service)
    if name is not None and i_max is not None:
        raise ConfigError("--i-max goes with --drive; of a service's drive [drives.NAME.limits] says it")
    if name is not None:
        by_service(name, service, diagnosis, ambiguity, out)
    elif drive is not None:
        directly(drive, diagnosis, ambiguity, out, i_max)


@app.command()
def commission(
    name: Annotated[str, Drive],
    first_start: Annotated[
        bool, Option("--first-start", help="pole pairs, phase order, direction and angle offset first, flashed as well")
    ] = False,
    forwards: Annotated[
        str, Option(metavar="encoder|phases", help="--first-start: whose direction is to be forwards")
    ] = "encoder",
    current: Annotated[
        float | None, Option(metavar="A", help="--first-start: most current (default: half of the rated one)")
    ] = None,
    bandwidth: Annotated[
        float | None, Option(metavar="RAD_PER_S", help="of the current control (default: 0.2 / control period)")
    ] = None,
    yes: Annotated[bool, Option("--yes", help="flash without asking")] = False,
    override: Annotated[str, Option(metavar="REASON", help="why doubts do not forbid a flash")] = "",
    out: Annotated[Path | None, Option("--report", metavar="FILE.html", help="a page of it")] = None,
    service: Service = None,
) -> None:
    """Find out about a motor, propose parameters, flash them when confirmed, and try the loops. The motor turns.

    Ctrl-C stops the drive.
    """
    from bench.cli.commands.commission import commissioned

    first = {"forwards": forwards, "current": current} if first_start else None
    raise typer.Exit(commissioned(name, service, first, bandwidth, override, out, ask=not yes))


@app.command("export-c")
def export_c(
    out: Annotated[Path, Option(metavar="DIR", help="a new folder")],
    window: Annotated[int, Option(metavar="N", help="samples")] = 400,
    parameters: Annotated[str, Option(metavar="R_s,L_q", help="what it estimates")] = "R_s,L_d,L_q",
    kind: Annotated[str, Option("--type", metavar="float32|float64", help="what it computes in")] = "float32",
    force: Annotated[bool, Option("--force", help="write over files that are there")] = False,
) -> None:
    """Write the windowed estimator as a C99 module for a drive's own processor, with test vectors."""
    from bench.cli.commands.export_c import run

    run(window, parameters, kind, out, force=force)


@app.command()
def registers(as_json: AsJson = False) -> None:
    """Print the Modbus registers of a drive."""
    from bench.cli.commands.registers import show

    show(as_json=as_json)


@app.command()
def doctor(
    config: Annotated[Path | None, Option(help="the service's configuration (default: none, as of `up`)")] = None,
    port: Port = None,
    as_json: AsJson = False,
) -> None:
    """Say whether a bench can run here: versions, configuration, folders, port, each drive's bus, clock.

    It writes nothing, on no bus either. Exit code: 0, all is well, or nearly; 1, something would fail; 2, wrong use.
    """
    from bench.cli.commands.doctor import run

    raise typer.Exit(run(config, port, as_json=as_json))


def _check_one(name: str | None, drive: str | None, service: str | None) -> None:
    """Raise ConfigError where a drive is named neither by a service nor by its bus, or by both."""
    if (name is None) == (drive is None):
        raise ConfigError("expected a drive's name, or its URL by --drive, got " + ("none" if name is None else "both"))
    if drive is not None and service is not None:
        raise ConfigError("expected --drive, which needs no service, or --service, got both")


def _written(text: str, out: Path | None) -> None:
    """A text on standard output, or in a file."""
    from bench.cli.output import check_new, write_whole

    if out is None:
        print(text)
        return
    check_new("--out", out)
    try:
        write_whole(out, text + "\n", over=False)
    except OSError as error:
        raise ConfigError(f"cannot write {out}: {error.strerror}") from None


def main() -> None:
    """Console script."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # of matrices as small as these a second thread only waits
    status: object = 0
    try:
        status = app(standalone_mode=False)
        print(end="", flush=True)  # what cannot be written is told here, and not by the interpreter at its end
    except InternalError as error:
        print(f"pmsm-bench: {_shown(error)}", file=sys.stderr)
        sys.exit(FAULT)
    except (ConfigError, LimitError) as error:
        for line in str(error).split("\n"):  # all that is wrong with a set has a line each
            print(f"pmsm-bench: {_shown(line)}", file=sys.stderr)
        sys.exit(REFUSED)
    except (BenchError, DriveError) as error:
        print(f"pmsm-bench: {_shown(error)}", file=sys.stderr)
        sys.exit(REFUSED)
    except SystemExit:  # the command-line library's own, where nobody reads what is written
        sys.exit(REFUSED)
    except (typer.Abort, KeyboardInterrupt):
        sys.exit(INTERRUPTED)
    except Exception as error:  # noqa: BLE001
        if isinstance(error, OSError) and error.errno in _NO_OUTPUT:
            _no_output(error)
        _unexpected(error)
    sys.exit(status if isinstance(status, int) else 0)


def _shown(said: object) -> str:
    from bench.cli.terminal import one_line

    return one_line(str(said).replace("\n", "; "))


def _no_output(error: OSError) -> NoReturn:
    """Nobody reads what we write, which is said nowhere; or there is no room for it."""
    if error.errno != errno.EPIPE:
        print(f"pmsm-bench: cannot write: {error.strerror}", file=sys.stderr)
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for what is still to be written at the end
    sys.exit(REFUSED)


def _unexpected(error: Exception) -> None:
    """Usage errors of the command-line library are sentences; anything else is our fault, and said as such."""
    format_message = getattr(error, "format_message", None)
    if format_message is not None:
        if said := format_message():  # nothing where the help has been shown instead
            print(f"pmsm-bench: {_shown(said)} (see --help)", file=sys.stderr)
        sys.exit(REFUSED)
    said = f"pmsm-bench failed: {type(error).__name__}: {_shown(error)}; please report this"
    print(said + details_kept(traceback.format_exc()), file=sys.stderr)
    sys.exit(FAULT)


if __name__ == "__main__":
    main()
