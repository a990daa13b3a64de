"""`pmsm-bench recordings`: what its subcommands take."""

from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

recordings = typer.Typer(
    no_args_is_help=True, add_completion=False,
    help="Record a drive's stream; list, show, mark, export, import, delete and verify what was recorded.",
)

Service = Annotated[
    str | None, Option(metavar="URL", help="the service (default http://127.0.0.1:8080, or PMSM_BENCH_PORT)")
]
Id = Annotated[str, Argument(help="id of a recording, or latest")]
Json = Annotated[bool, Option("--json", help="as JSON")]


@recordings.command()
def start(
    name: Annotated[str, Argument(help="the drive")],
    title: Annotated[str, Option(help="a few words")] = "",
    note: Annotated[str, Option(help="whatever is to be known of it")] = "",
    trigger: Annotated[str, Option(metavar="now|i_q>2.0", help="what starts it; levels in SI")] = "now",
    pre_trigger: Annotated[float, Option(metavar="S", help="time before the trigger that is kept")] = 0.0,
    timeout: Annotated[float | None, Option(metavar="S", help="for the trigger to come")] = None,
    seconds: Annotated[float | None, Option(metavar="S", help="after which it ends by itself")] = None,
    megabytes: Annotated[float | None, Option(metavar="MB", help="on disk, at which it ends by itself")] = None,
    service: Service = None,
) -> None:
    """Begin to record a drive's stream; the service goes on with it until `stop`, or a limit."""
    from bench.cli.commands.recordings import begin

    begin(name, {
        "title": title, "note": note, "trigger": trigger, "pre_trigger_s": pre_trigger, "timeout_s": timeout,
        "seconds": seconds, "megabytes": megabytes,
    }, service)  # fmt: skip


@recordings.command()
def stop(id_: Id = "latest", service: Service = None) -> None:
    """End a recording, and wait until it is closed."""
    from bench.cli.commands.recordings import end

    end(id_, service)


@recordings.command("list")
def list_(
    drive: Annotated[str, Option(help="of this drive alone")] = "",
    kind: Annotated[str, Option(help="stream, capture, experiment or file")] = "",
    text: Annotated[str, Option(help="in id, title, note or a mark")] = "",
    limit: Annotated[int, Option(help="how many, the newest")] = 50,
    json: Json = False,
    service: Service = None,
) -> None:
    """Recordings, the newest first."""
    from bench.cli.commands.recordings import show_all

    filters = {"drive": drive, "kind": kind, "text": text, "limit": str(limit)}
    show_all({key: value for key, value in filters.items() if value}, service, as_json=json)


@recordings.command()
def show(id_: Id, json: Json = False, service: Service = None) -> None:
    """All that is known of a recording."""
    from bench.cli.commands.recordings import show_one

    show_one(id_, service, as_json=json)


@recordings.command()
def mark(
    id_: Id,
    text: Annotated[str, Argument(help="what happened")],
    t: Annotated[float | None, Option("--t", metavar="S", help="s from its begin (default: now)")] = None,
    service: Service = None,
) -> None:
    """Mark a moment of a recording."""
    from bench.cli.commands.recordings import set_mark

    set_mark(id_, text, t, service)


@recordings.command()
def annotate(
    id_: Id,
    title: Annotated[str | None, Option(help="a few words")] = None,
    note: Annotated[str | None, Option(help="whatever is to be known of it")] = None,
    service: Service = None,
) -> None:
    """Give a recording another title or note."""
    from bench.cli.commands.recordings import set_title

    set_title(id_, title, note, service)


@recordings.command()
def export(
    id_: Id,
    out: Annotated[Path, Option(metavar="FILE", help="a new file: .parquet, .csv, .mat or .mf4")],
    form: Annotated[
        str | None, Option("--format", metavar="parquet|csv|mat|mf4", help="whatever its name ends with")
    ] = None,
    service: Service = None,
) -> None:
    """Write a recording to a file of one's own: Parquet, CSV, a struct of MATLAB's, or ASAM MDF 4."""
    from bench.cli.commands.recordings import save

    save(id_, out, form, service)


@recordings.command("import")
def import_(
    file: Annotated[Path, Argument(help="CSV, CSV.gz, Parquet, .mat or .mf4")],
    mapping: Annotated[
        list[str] | None, Option("--map", metavar="NAME=COLUMN,...", help="columns called otherwise; COLUMN[UNIT], too")
    ] = None,
    constants: Annotated[
        list[str] | None, Option("--set", metavar="NAME=VALUE,...", help="values in place of columns")
    ] = None,
    align: Annotated[
        list[str] | None, Option(metavar="u=ROWS", help="the voltage in row k was applied ROWS later")
    ] = None,
    title: Annotated[str, Option(help="a few words")] = "",
    note: Annotated[str, Option(help="whatever is to be known of it")] = "",
    service: Service = None,
) -> None:
    """Bring a file to the service: it becomes a recording, in SI, that is listed, plotted and diagnosed."""
    from bench.cli.commands.recordings import bring

    said = {"map": mapping or [], "set": constants or [], "align": align or []}
    bring(file, {key: ",".join(items) for key, items in said.items()} | {"title": title, "note": note}, service)


@recordings.command()
def delete(
    id_: Annotated[str, Argument(help="id of a recording")],
    yes: Annotated[bool, Option("--yes", help="without asking")] = False,
    service: Service = None,
) -> None:
    """Delete a recording from the service's disk, for good."""
    from bench.cli.commands.recordings import remove

    remove(id_, service, asked=not yes)


@recordings.command()
def verify(
    folder: Annotated[Path | None, Argument(help="of recordings (default: the usual one)")] = None,
    database: Annotated[
        str | None, Option(metavar="FILE|URL", help="the catalogue, which is told (default: the usual one)")
    ] = None,
    json: Json = False,
) -> None:
    """Read every recording and diagnosis of a folder against its checksums, and have the catalogue say what they do.

    Exit code 1: one is damaged, or was not closed.
    """
    from bench.cli.commands.files.verify import check_all

    raise typer.Exit(check_all(folder, database, as_json=json))
