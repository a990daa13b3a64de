"""The service killed while it records a drive's stream and a capture is under way.

`python -m tests.bars.bench_recordings [--count 100] [--link NAME]`

Over each link in turn a recording of the stream and a capture begin; the service is killed (SIGKILL) after a random
time - at every third kill just after the recording was told to stop, so that it is being closed - and started again.
Printed: how much of the stream before the kill is lost (bar: 1 s), whether both are recovered whole, and that nothing
is listed that cannot be read.
"""

import argparse
import random
import sys
import tempfile
import threading
import time
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import httpx

from bench.recordings.recording import open_recording, whole
from bench.recordings.table import check_undamaged, notes
from tests.bars.bench_kills import LINKS, Service, until
from tests.support.served_drive import emulator, ready

MOST_LOST = 1.0  # s
CAPTURE = {"length": 20_000, "trigger": "now"}


@dataclass
class Seen:
    """One kill."""

    link: str
    after: float  # s, of recording
    closing: bool  # it had been told to stop
    lost: float = 0.0  # s of the stream before the kill
    rows: int = 0
    said: str = ""  # why it ended
    wrong: list[str] = field(default_factory=list[str])

    @property
    def good(self) -> bool:
        """All that is asked for."""
        return not self.wrong and self.lost <= MOST_LOST


def asked(service: Service, method: str, path: str, **body: Any) -> dict[str, Any]:
    """An answer of the service."""
    return httpx.request(method, f"{service.url}/api{path}", timeout=20.0, **body).raise_for_status().json()


def killed(service: Service, folder: Path, one: Seen) -> None:
    """One kill, and all that follows."""
    id_ = asked(service, "POST", "/drives/x/recordings", json={"title": "kill"})["id"]
    capture = asked(service, "POST", "/drives/x/captures", json=CAPTURE)["id"]
    until(lambda: asked(service, "GET", f"/recordings/{id_}")["rows"] > 0, "no rows are recorded")
    time.sleep(one.after)
    if one.closing:
        asked(service, "POST", f"/recordings/{id_}/stop", json={})
        time.sleep(random.uniform(0.0, 0.6))  # it may be closed already
    ended = datetime.now(UTC)
    service.kill()
    service.start()
    until(lambda: not list(folder.glob("*.stream")), "the recording is not closed")
    listed = dict[str, Any]()

    def is_listed() -> bool:
        listed.update((found["id"], found) for found in asked(service, "GET", "/recordings?limit=1000")["recordings"])
        return capture in listed

    until(is_listed, "no end of the capture")  # it may have ended before the kill
    for name in (id_, capture):
        if name not in listed:
            one.wrong.append(f"{name} is not listed")
    one.wrong += [f"{name}: {found['reason']}" for name, found in listed.items() if not found["rows"]]
    parts = [id_]  # rows of another length go on in another recording
    while found := [other for other, told in listed.items() if told["continues"] == parts[-1]]:
        parts += found
    for name in (*parts, capture):
        check_undamaged(folder / f"{name}.parquet")
    begun, duration = ended, 0.0
    for name in parts:
        path = folder / f"{name}.parquet"
        with open_recording(path) as reader:
            summary = whole(reader).summary
        noted = notes(path)
        begun, duration = datetime.fromisoformat(noted["begun"]), summary.duration
        one.rows, one.said = one.rows + summary.rows, str(noted["ended"])
        if summary.lost_rows != listed[name]["rows_lost"] or summary.left_out or summary.irregular_steps:
            one.wrong.append(f"rows are missing: {summary.remarks()}")
    if not one.closing:
        one.lost = (ended - begun).total_seconds() - duration
    left = [found.name for found in folder.iterdir() if found.suffix not in (".parquet", ".json")]
    if left:
        one.wrong.append(f"left over: {', '.join(left)}")
    for name in (*parts, capture):
        httpx.delete(f"{service.url}/api/recordings/{name}", timeout=20.0).raise_for_status()


def on_link(name: str, count: int, seen: list[Seen]) -> None:
    """So many kills over one link."""
    url, chance = LINKS[name](), random.Random(name)
    with tempfile.TemporaryDirectory() as folder, emulator("--at", url) as process:
        ready(process)
        service = Service(Path(folder), url)
        service.start()
        for k in range(count):
            one = Seen(name, chance.uniform(0.0, 4.0), k % 3 == 2)
            try:
                killed(service, Path(folder) / "captures", one)
            except (TimeoutError, httpx.HTTPError, ValueError, OSError) as error:
                one.wrong.append(f"{type(error).__name__}: {error}")
            seen.append(one)
            print(told(one), flush=True)
        service.kill()


def told(one: Seen) -> str:
    """A line of the table."""
    when = f"killed after {one.after:.2f} s" + (" while it was closed" if one.closing else "")
    return (
        f"{'ok  ' if one.good else 'FAIL'} {one.link:10} {when:38}: {one.rows:5} rows, "
        + ("" if one.closing else f"{one.lost:.2f} s lost, ") + f"{one.said}{'; ' if one.wrong else ''}"
        + "; ".join(one.wrong)
    )


def main() -> int:
    """0 where nothing was lost beyond the last second."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100, help="kills, over all links")
    parser.add_argument("--link", choices=LINKS, action="append")
    options = parser.parse_args()
    links, seen = options.link or list(LINKS), list[Seen]()
    threads = [
        threading.Thread(target=on_link, args=(link, -(-options.count // len(links)), seen)) for link in links
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    good, most = sum(one.good for one in seen), max((one.lost for one in seen), default=0.0)
    print(f"{good} of {len(seen)} as they should be; at most {most:.2f} s of a stream lost, bar {MOST_LOST:g} s")
    return int(good < len(seen))


if __name__ == "__main__":
    sys.exit(main())
