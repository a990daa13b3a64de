"""The routes of recordings, over a running service."""

import csv
import io
import threading
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path as File
from typing import Annotated, Any, BinaryIO, Final, Literal
from urllib.parse import quote

from anyio import to_thread
from fastapi import FastAPI, Path, Query, Request, Response
from fastapi.responses import FileResponse, StreamingResponse
from pydantic import TypeAdapter

from bench.actions.recording import Status
from bench.api.captures import FILE, MEDIA
from bench.api.exchange.answers import (
    CHANGED,
    DRIVE,
    PROBLEM,
    Answers,
    Before,
    DriveName,
    Limit,
    Place,
    body_of,
    json_object,
    of_known,
    page_of,
)
from bench.api.exchange.kinds import BYTES
from bench.api.exchange.upload import brought
from bench.api.guard.idempotency import REPEATABLE
from bench.api.guard.preconditions import TAGGED, IfMatch, check_match, tag_of
from bench.api.models.recordings import (
    AnnotationModel,
    BroughtModel,
    MarkRequestModel,
    RecordingsModel,
    RoomModel,
    SamplesModel,
    StoredRecordingModel,
    of_shelf,
    samples_model,
    under_way,
)
from bench.errors import ConflictError, LimitError, UnavailableError, UnknownError
from bench.expected import Table, taken
from bench.jobs import LATEST
from bench.recordings.column_options import columns_of
from bench.recordings.table import ROWS, column_names, read_parts
from bench.service.service import Service
from bench.store.annotations import Annotations, Mark
from bench.store.export import exported
from bench.store.importing import Import, remarks_of
from bench.store.samples import MOST_POINTS, samples_of
from bench.store.shelf import Shelf

Form = Literal["parquet", "csv", "mat", "mf4"]
FOREIGN: Final = {"mat": ("mat", "application/x-matlab-data"), "mf4": ("mdf", "application/x-mdf")}  # name, media
_ROOT: Final = "/api/recordings/{id}"
_WRONG: Answers = {422: {"description": "Not what can be asked for"} | PROBLEM}
_ONE: Answers = {404: {"description": "No recording of that name"} | PROBLEM}
_ASKED: Answers = {
    409: {"description": "The drive is recorded already"} | PROBLEM,
    422: {"description": "Not a recording that can be made"} | PROBLEM,
    503: {"description": "There is no link to the drive, or no room on the disk"} | PROBLEM,
}
_NOT_NOW: Answers = {409: {"description": "The recording is in another state"} | PROBLEM}
_TAGGED: Answers = {200: {"description": "Successful Response", "headers": TAGGED}}  # of title and note alone
_FILES: Answers = {200: {"description": "The recording", "content": FILE[200]["content"] | {
    "text/csv": {"schema": {"type": "string"}},
    **{media: {"schema": {"type": "string", "format": "binary"}} for _, media in FOREIGN.values()}}}}
_BROUGHT: Answers = {
    422: {"description": "Not a file that can be read, or not what can be said of one"} | PROBLEM,
    503: {"description": "There is no room on the disk"} | PROBLEM,
}
_MARK: Final = TypeAdapter(Annotated[MarkRequestModel, Table("expected what to mark")])
_ANNOTATION: Final = TypeAdapter(Annotated[AnnotationModel, Table("expected a title, or a note")])
RecordingId = Annotated[str, Path(alias="id", description="id of a recording, or latest")]


def install(app: FastAPI, service: Service) -> None:
    """Add the routes to an application."""

    found = _Found(service)
    _install_live(app, service, found)
    _install_shelf(app, service, found)
    _install_files(app, service, found)


class _Found:
    """Recordings by id, under way and closed."""

    def __init__(self, service: Service) -> None:
        self._recordings, self._shelf, self._drives = service.recordings, service.shelf, service.drives

    def one(self, id_: str) -> StoredRecordingModel:
        """By its id, or `latest`: one under way goes before those that have ended. Raises UnknownError."""
        if id_ == LATEST and (live := self._recordings.newest_under_way()) is not None:
            id_ = live.id
        elif id_ == LATEST and (every := self.all()):
            return every[0]
        status = self._recordings.find(id_)
        if status is not None and status.file is None:
            return under_way(status, self._drives[status.drive].url, Annotations.read(self._shelf.folder, id_))
        return of_shelf(self._shelf.one(id_))

    def running(self, id_: str) -> Status | None:
        """One that is under way."""
        status = self._recordings.find(id_)
        return None if status is None or status.state.ended else status

    def all(self) -> list[StoredRecordingModel]:
        """The newest first."""
        live = [self.one(one.id) for one in self._recordings.known() if one.file is None and not _is_cancelled(one)]
        there = {one.id for one in live}
        every = live + [of_shelf(one) for one in self._shelf.all() if one.id not in there]
        return sorted(every, key=_place, reverse=True)


def _install_live(app: FastAPI, service: Service, found: _Found) -> None:
    """Routes of what is under way."""

    recordings, known = service.recordings, of_known(service)

    @app.get("/api/drives/{name}/recordings", summary="A drive's recording, and room for one", responses=DRIVE,
             dependencies=known)
    def room(name: DriveName) -> RoomModel:
        """What is being recorded of the drive's stream, how much a day of it takes, and how many days there is room."""
        status = recordings.under_way(name)
        told = service.room_for(name)
        return RoomModel(
            recording=None if status is None else found.one(status.id), bytes_per_day=told.bytes_per_day,
            free_bytes=told.free_bytes, days=told.days,
        )

    @app.post("/api/drives/{name}/recordings", summary="Record a drive's stream", status_code=202,
              responses=_ASKED | DRIVE, openapi_extra=body_of("RecordingRequestModel") | REPEATABLE, dependencies=known)
    def ask_recording(
        name: DriveName, request: Request, response: Response,
        given: Annotated[dict[str, Any], json_object({"seconds": 60.0}, required=False)],
    ) -> StoredRecordingModel:
        """Every row that comes, on disk within half a second, until it is stopped or comes to a limit.

        One at a time per drive; nothing is written to the drive. A lost link is a gap, which the recording tells. If
        the service ends or is killed, the recording ends with it, and is closed by the next.
        """
        status = recordings.ask(name, given, _who(request))
        response.headers["Location"] = f"/api/recordings/{quote(status.id)}"
        return found.one(status.id)

    @app.post(f"{_ROOT}/stop", summary="End a recording", responses=_NOT_NOW | _ONE,
              openapi_extra=body_of("NothingModel"), dependencies=[json_object({}, required=False)])
    def stop_recording(id_: RecordingId, request: Request) -> StoredRecordingModel:
        """What was recorded is closed then: state closing, at last done."""
        id_ = found.one(id_).id
        status = found.running(id_)
        if status is None:
            raise ConflictError(f"recording {id_} has ended, there is nothing to stop")
        recordings.stop(status, _who(request))
        return found.one(id_)


def _install_shelf(app: FastAPI, service: Service, found: _Found) -> None:
    """Routes of all recordings."""

    recordings, shelf = service.recordings, service.shelf

    @app.get("/api/recordings", summary="All recordings", responses=_WRONG)
    def all_recordings(
        drive: Annotated[str, Query(description="of this drive alone")] = "",
        kind: Annotated[Literal["stream", "capture", "experiment", "file"] | None, Query()] = None,
        text: Annotated[str, Query(description="in id, title, note or a mark", max_length=200)] = "",
        before: Before = None,
        limit: Limit = 50,
    ) -> RecordingsModel:
        """Of streams, captures, experiments, and files in the service's folder; the newest first."""
        wanted = [one for one in found.all() if (not drive or one.drive == drive) and kind in (None, one.kind)
                  and _mentions(one, text)]
        page, total, more = page_of(wanted, _place, before, limit)
        return RecordingsModel(recordings=page, total=total, next=more)

    changing = threading.Lock()  # titles and notes: between what a client has seen and the change nothing else does

    @app.get(_ROOT, summary="A recording", responses=_TAGGED | _ONE)
    def one_recording(id_: RecordingId, response: Response) -> StoredRecordingModel:
        """What is known of it. The ETag is of title and note, which can be changed."""
        return _tagged(found.one(id_), response)

    @app.patch(_ROOT, summary="Title and note of a recording", responses=_TAGGED | CHANGED | _ONE,
               openapi_extra=body_of("AnnotationModel"))
    def annotate(
        id_: RecordingId, response: Response, given: Annotated[dict[str, Any], json_object({"title": "warm"})],
        if_match: IfMatch = None,
    ) -> StoredRecordingModel:
        """What the body leaves out stays as it is."""
        said = taken(_ANNOTATION, given, "", LimitError)
        with changing:
            before = found.one(id_)
            check_match(_tag_of_words(before), if_match)
            _kept(lambda: shelf.annotate(before.id, said.title, said.note))
        return _tagged(found.one(before.id), response)

    @app.post(f"{_ROOT}/marks", summary="Mark a moment of a recording", responses=_NOT_NOW | _ONE,
              openapi_extra=body_of("MarkRequestModel"))
    def mark(
        id_: RecordingId, request: Request, given: Annotated[dict[str, Any], json_object({"text": "load on"})]
    ) -> StoredRecordingModel:
        """Now, of one that is under way, or where t says."""
        wanted, id_ = taken(_MARK, given, "", LimitError), found.one(id_).id
        status = found.running(id_)
        if status is not None and wanted.t is None:
            recordings.mark(status, wanted.text, _who(request))
        elif status is not None:
            raise ConflictError(f"recording {id_} is under way: it is marked where it is now, without t")
        elif wanted.t is None:
            raise LimitError(f"t: expected s from the begin of {id_}, which has ended, got null")
        else:
            at = datetime.now().astimezone().isoformat()
            one = Mark(wanted.t, wanted.text, _who(request), at)
            _kept(lambda: shelf.mark(id_, one))
        return found.one(id_)

    @app.delete(_ROOT, summary="Delete a recording", responses=_ONE | {
        503: {"description": "It cannot be removed"} | PROBLEM})
    def delete(id_: Annotated[str, Path(alias="id", description="id of a recording, which says which")]) -> (
        StoredRecordingModel
    ):
        """From the disk, for good; one that is under way is ended and discarded. Tells what it was."""
        if id_ == LATEST:
            raise UnknownError("expected the id of the recording that is to be deleted, got latest")
        one, status = found.one(id_), found.running(id_)
        if status is not None:
            recordings.discard(status)
        else:
            _kept(lambda: shelf.delete(id_))
        return one


def _ended(found: _Found, shelf: Shelf, id_: str) -> File:
    """The file of a recording. Raises ConflictError while it is under way, UnknownError where there is none."""
    if found.running(id_) is not None:
        raise ConflictError(f"recording {id_} is under way: expected one that has ended")
    return shelf.one(id_).path


def _install_files(app: FastAPI, service: Service, found: _Found) -> None:
    """Routes of what is in recordings: brought, plotted, handed out."""

    shelf = service.shelf

    @app.post("/api/recordings", summary="Bring a file of recorded rows", responses=_BROUGHT, openapi_extra={
        "requestBody": {"required": True, "content": {BYTES: {"schema": {"type": "string", "format": "binary"}}}}})
    async def bring_recording(
        request: Request, response: Response,
        name: Annotated[str, Query(description="the file's, without folders", examples=["run.csv"])],
        title: Annotated[str, Query(max_length=200)] = "",
        note: Annotated[str, Query(max_length=4000)] = "",
        mapping: Annotated[str, Query(alias="map", description="NAME=COLUMN,...", max_length=4000)] = "",
        constants: Annotated[str, Query(alias="set", description="NAME=VALUE,...", max_length=4000)] = "",
        align: Annotated[str, Query(description="u=ROWS", max_length=100)] = "",
    ) -> BroughtModel:
        """CSV, CSV.gz, Parquet, .mat or ASAM MDF becomes a recording of the service's own, of kind file, in SI.

        Rows are taken as `pmsm-bench replay` takes them, with their temperatures; what is left out is told.
        """
        columns = columns_of([mapping], [constants], [align], "")
        said = Import(name, title, note, *columns, whom=_who(request))
        id_ = await brought(service, request, said)
        response.headers["Location"] = f"/api/recordings/{quote(id_)}"
        one = await to_thread.run_sync(found.one, id_)
        remarks = await to_thread.run_sync(remarks_of, shelf.one(id_).path)
        return BroughtModel(**one.model_dump(), remarks=remarks)

    @app.get(f"{_ROOT}/samples", summary="A recording's columns for a plot", response_model=SamplesModel,
             responses=_NOT_NOW | _ONE | _WRONG)
    def recording_samples(
        id_: RecordingId,
        signals: Annotated[
            str, Query(description="names with commas; none: all, up to 16", max_length=2000, examples=["i_d,i_q"])
        ] = "",
        since: Annotated[
            float, Query(description="s from its begin", ge=0.0, le=1e9, allow_inf_nan=False)
        ] = 0.0,
        until: Annotated[
            float | None, Query(description="s from its begin; its end", ge=0.0, le=1e9, allow_inf_nan=False)
        ] = None,
        points: Annotated[int, Query(description="at most; besides, breaks", ge=1, le=MOST_POINTS)] = 1000,
    ) -> Response:
        """Thinned where there are more rows than points, each signal's lowest, mean and highest value kept.

        A gap is a point with null. Of a long recording, what is asked for first is worked on for some seconds.
        """
        id_ = found.one(id_).id
        path = _ended(found, shelf, id_)
        names = [name.strip() for name in signals.split(",") if name.strip()]
        told = samples_model(id_, samples_of(path, names, since, until, points))
        return Response(told.model_dump_json(), media_type="application/json")

    @app.head(f"{_ROOT}/file", include_in_schema=False)
    @app.get(f"{_ROOT}/file", summary="Download a recording", response_class=FileResponse,
             responses=_FILES | _NOT_NOW | _ONE | _WRONG)
    def recording_file(
        id_: RecordingId, format: Annotated[Form, Query()] = "parquet"  # noqa: A002
    ) -> Response:
        """As Parquet, as it is on disk, as CSV, as MATLAB's struct `recording`, or as ASAM MDF 4; SI."""
        id_ = found.one(id_).id
        path = _ended(found, shelf, id_)
        if format in FOREIGN:
            return _foreign(shelf, id_, format)
        if format == "parquet":
            return FileResponse(path, media_type=MEDIA, filename=path.name)
        headers = {"Content-Disposition": f'attachment; filename="{quote(id_)}.csv"'}
        return StreamingResponse(_as_csv(path), media_type="text/csv", headers=headers)


def _tag_of_words(one: StoredRecordingModel) -> str:
    return tag_of(one, include={"title", "note"})


def _tagged(one: StoredRecordingModel, response: Response) -> StoredRecordingModel:
    response.headers["ETag"] = _tag_of_words(one)
    return one


def _who(request: Request) -> str:
    return "" if request.client is None else request.client.host


def _is_cancelled(status: Status) -> bool:
    return status.state.value == "cancelled"


def _place(one: StoredRecordingModel) -> Place:
    return one.begun, one.id


def _mentions(one: StoredRecordingModel, text: str) -> bool:
    said = " ".join((one.id, one.title, one.note, *(mark.text for mark in one.marks)))
    return text.lower() in said.lower()


def _kept(do: Any) -> None:
    """Do something on the disk. Raises UnavailableError in place of OSError, UnknownError where the file is gone."""
    try:
        do()
    except FileNotFoundError as error:
        raise UnknownError(f"it is no longer there: {error.filename}") from None
    except OSError as error:
        raise UnavailableError(f"the folder of recordings cannot be written: {error.strerror or error}") from None


def _foreign(shelf: Shelf, id_: str, ending: str) -> Response:
    """A recording in another tool's form. Raises RecordingError, UnavailableError."""
    form, media = FOREIGN[ending]
    try:
        file, size = exported(shelf.one(id_), form)
    except OSError as error:
        raise UnavailableError(f"it cannot be written: {error.strerror or error}") from None
    headers = {"Content-Disposition": f'attachment; filename="{quote(id_)}.{ending}"', "Content-Length": str(size)}
    return StreamingResponse(_pieces(file), media_type=media, headers=headers)


def _pieces(file: BinaryIO) -> Iterator[bytes]:
    with file:
        while piece := file.read(1 << 20):
            yield piece


def _as_csv(path: File) -> Iterator[str]:
    names = column_names(path)
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(names)
    for part in read_parts(path, names, ROWS):
        writer.writerows(zip(*(part[name].tolist() for name in names), strict=True))
        yield text.getvalue()
        text.seek(0)
        text.truncate()
