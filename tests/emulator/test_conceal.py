"""Concealed recordings: deterministic, made anew from their answers, readable by the bench, told apart by nothing but
their signals."""

import json
import os
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
import pytest

from bench.cli.main import main as pmsm_bench
from emulator.bounds import ScenarioError
from emulator.conceal.chance import Chance
from emulator.conceal.files import made_anew
from emulator.conceal.measuring_chain import CHAIN, drawn_chain
from emulator.conceal.population import Population, Setting
from emulator.conceal.populations import EFFECTS, KINDS, POPULATIONS, STRANGERS, chosen, merged
from emulator.conceal.recording import Choice, TripError, drawn, recorded
from emulator.conceal.runs import drawn_run
from emulator.conceal.suite import SHORTEST, Suite, make
from emulator.plant.physics.strangers import Stray
from emulator.scenario.effects import NONE, effects_from_table
from emulator.scenario.motors import MOTORS, TOLERANCE
from emulator.scenario.scenarios import BUILT_IN, PAPER, Scenario, check, parse
from emulator.scenario.text import text_of
from tests.conftest import READY
from tests.support.leaks import Features, findable, outside_of, planted, told_apart
from tests.support.recordings import read_recording

pytestmark = pytest.mark.slow

pq: Any = pyarrow.parquet  # comes without types

COUNT = 200
SEED = 11
PARAMETERS = ("R_s", "L_d", "L_q", "psi_f")


def conceal(*arguments: str | Path) -> "subprocess.Popen[str]":
    """`python -m emulator conceal` as a process, with a group of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "emulator", "conceal", *map(str, arguments)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip


def made(*arguments: str | Path) -> str:
    """What a suite that succeeds says."""
    process = conceal(*arguments)
    out, said = process.communicate(timeout=READY + 120.0)
    assert process.returncode == 0, said
    assert out == ""
    return said


@pytest.fixture(scope="module")
def suite(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with many short recordings in `out` and their answers in `answers`, made by two processes."""
    folder = tmp_path_factory.mktemp("suite")
    said = made(
        "--count", str(COUNT), "--seed", str(SEED), "--out", folder / "out", "--answers", folder / "answers",
        "--length", str(SHORTEST), "--workers", "2",
    )  # fmt: skip
    assert f"{COUNT} of {COUNT} recordings, " in said
    return folder


def answers_in(folder: Path) -> list[dict[str, Any]]:
    """All answers, by name."""
    return [json.loads(path.read_text()) for path in sorted(folder.glob("[0-9]*.json"))]


def columns_of(path: Path) -> dict[str, np.ndarray]:
    table = pq.read_table(path)
    return {name: table[name].to_numpy() for name in table.column_names}


def test_the_same_seed_gives_the_same_bytes_whatever_the_processes_and_the_count(suite: Path, tmp_path: Path) -> None:
    choice = Choice(SEED, KINDS, (0.0, 1.0), tuple(MOTORS), SHORTEST)
    heard: list[int] = []
    assert make(Suite(choice, 5, tmp_path / "out", tmp_path / "answers", workers=1), heard.append) == 5
    assert heard == [0, 1, 2, 3, 4, 5]
    for folder in ("out", "answers"):
        names = [path.name for path in (tmp_path / folder).iterdir() if path.name != "manifest.json"]
        assert len(names) == (10 if folder == "out" else 5)
        for name in names:
            assert (tmp_path / folder / name).read_bytes() == (suite / folder / name).read_bytes(), name


def test_another_seed_gives_other_recordings() -> None:
    choices = [Choice(seed, ("none",), (0.0, 1.0), tuple(MOTORS), SHORTEST) for seed in range(4)]
    assert len({text_of(drawn(choice, 1)[0].scenario) for choice in choices}) == 4


def test_an_answer_makes_its_recording_anew_number_for_number(suite: Path) -> None:
    seen: set[str] = set()
    for answer in answers_in(suite / "answers"):
        if answer["kind"] in seen:
            continue
        seen.add(answer["kind"])
        stored, anew = columns_of(suite / "out" / f"{answer['recording']}.parquet"), made_anew(answer)
        assert list(stored) == list(anew)
        for name, column in anew.items():
            np.testing.assert_array_equal(stored[name], column)
    assert seen == set(KINDS)


def test_every_built_in_scenario_survives_its_text() -> None:
    for scenario in BUILT_IN.values():
        assert parse(text_of(scenario), scenario.name) == scenario


def test_one_number_is_one_run_in_every_class() -> None:
    def scenario(kind: str) -> Scenario:
        return drawn(Choice(3, (kind,), (0.0, 1.0), tuple(MOTORS), SHORTEST), 8)[0].scenario

    none = scenario("none")
    for kind in ("dead_time", "three", "telegraph"):
        other = scenario(kind)
        assert other.effects != none.effects
        assert (other.motor, other.drive, other.run, other.excitation) == (
            none.motor, none.drive, none.run, none.excitation,
        )  # fmt: skip


def test_every_class_can_be_had_by_every_motor_in_its_range() -> None:
    for number, motor in enumerate(MOTORS):
        for name, population in POPULATIONS.items():
            for window in ((0.0, 0.0), (1.0, 1.0)):
                chance = Chance(SEED, number, name)
                run = drawn_run(Chance(SEED, number, "run"), (motor,), 1.0)
                size = population.drawn(chance, window)
                assert size == pytest.approx(population.high if window[0] else population.low)
                setting = Setting(run.machine, run.omega_e, run.drive.u_dc, run.drive.T_s, 1.0)
                sections = population.sizes(size, setting, chance)
                effects = effects_from_table(merged([run.surroundings, sections]), "", Path())
                assert effects != effects_from_table(run.surroundings, "", Path())
                check(Scenario(f"{motor} with {name}", run.machine, run.drive, run.run, run.excitation, effects))


def test_sizes_stay_in_the_stated_range_and_its_part() -> None:
    for name, population in POPULATIONS.items():
        sizes = [population.drawn(Chance(SEED, n, name), (0.25, 0.5)) for n in range(200)]
        ratio = population.high / population.low
        assert population.low * ratio**0.25 <= min(sizes) <= max(sizes) <= population.low * ratio**0.5 + 1e-12
        if ratio > 1.0:  # all of the part, evenly in the logarithm
            place = np.log(np.array(sizes) / population.low) / np.log(ratio)
            assert np.histogram(place, 4, (0.25, 0.5))[0].min() > 25


def test_kinds_hold_as_many_effects_as_they_say_and_none_twice() -> None:
    for n in range(300):
        for count, kind in enumerate(("none", "one", "two", "three")):
            classes = chosen(kind, Chance(SEED, n, kind))
            assert len(set(classes)) == len(classes) == count
            assert set(classes) <= set(EFFECTS)
            run = drawn_run(Chance(SEED, n, "run"), tuple(MOTORS), 1.0)
            setting = Setting(run.machine, run.omega_e, run.drive.u_dc, run.drive.T_s, 1.0)
            parts = [POPULATIONS[name].sizes(POPULATIONS[name].low, setting, Chance(SEED, n, name)) for name in classes]
            keys = [(section, key) for part in parts for section, keys in part.items() for key in keys]
            assert len(keys) == len(set(keys)), classes  # no effect undoes another
        assert chosen("stranger", Chance(SEED, n, "stranger"))[0] in STRANGERS


def test_a_measuring_chain_is_drawn_beside_the_class_and_changes_neither_class_nor_run() -> None:
    kinds = ("none", "one")
    plain, chained = (Choice(SEED, kinds, (0.0, 1.0), tuple(MOTORS), SHORTEST, chain) for chain in (False, True))
    sensors = set[int]()
    for number in range(12):
        one, other = drawn(plain, number)[0], drawn(chained, number)[0]
        chain = drawn_chain(Chance(SEED, number, "chain"))
        assert set(chain.classes) <= set(CHAIN)
        assert other.classes == (*one.classes, *chain.classes)
        assert other.scenario.drive.current_sensors == chain.current_sensors
        if one.redrawn == other.redrawn:
            assert (one.scenario.motor, one.scenario.run) == (other.scenario.motor, other.scenario.run)
            assert {name: other.sizes[name] for name in one.sizes} == one.sizes
        sensors.add(chain.current_sensors)
        asked = drawn(replace(chained, current_sensors=2), number)[0]
        assert asked.scenario.drive.current_sensors == 2
        assert asked.classes == other.classes
    assert sensors == {2, 3}


def test_answers_tell_classes_sizes_and_a_machine_within_tolerance_of_the_nominal_one(suite: Path) -> None:
    answers = answers_in(suite / "answers")
    assert len(answers) == COUNT
    assert {name for answer in answers for name in answer["classes"]} >= set(STRANGERS)
    for answer in answers:
        assert list(answer["sizes"]) == answer["classes"]
        for told in answer["sizes"].values():
            low, high = told["range"]
            assert low * (1.0 - 1e-9) <= told["value"] <= high * (1.0 + 1e-9)
        nominal = tomllib.loads((suite / "out" / f"{answer['recording']}.toml").read_text())["machine"]
        for name in PARAMETERS:
            assert abs(answer["machine"][name]["value"] / nominal[name] - 1.0) <= TOLERANCE
        effects = parse(answer["scenario"], "answer").effects
        assert {key for key in NONE._fields if getattr(effects, key) != getattr(NONE, key)} == set(answer["effects"])
        if answer["kind"] == "none":
            assert set(answer["effects"]) == set(answer["surroundings"])


def test_a_manifest_lists_what_was_made(suite: Path) -> None:
    manifest = json.loads((suite / "answers" / "manifest.json").read_text())
    answers = answers_in(suite / "answers")
    assert (manifest["seed"], manifest["count"], manifest["made"]) == (SEED, COUNT, COUNT)
    assert [line["recording"] for line in manifest["recordings"]] == [answer["recording"] for answer in answers]
    assert [line["classes"] for line in manifest["recordings"]] == [answer["classes"] for answer in answers]
    assert sorted(path.name for path in (suite / "out").iterdir()) == sorted(
        f"{answer['recording']}.{end}" for answer in answers for end in ("parquet", "toml")
    )


def test_recordings_without_effect_tell_the_true_machine_by_replay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    choice = Choice(4, ("none",), (0.0, 1.0), tuple(MOTORS), 1.0)
    make(Suite(choice, 6, tmp_path / "out", tmp_path / "answers", workers=1), lambda _: None)
    told = 0
    for answer in answers_in(tmp_path / "answers"):
        name = answer["recording"]
        file, report = tmp_path / "out" / f"{name}.parquet", tmp_path / f"{name}.json"
        arguments = ["replay", file, "--nominal", file.with_suffix(".toml"), "--periods", "20", "--json", report]
        monkeypatch.setattr(sys, "argv", ["pmsm-bench", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            pmsm_bench()
        assert not ended.value.code
        for name, estimate in json.loads(report.read_text())["estimates"].items():
            if estimate["status"] == "ok":
                told += 1
                assert abs(estimate["value"] - answer["machine"][name]["value"]) < 4.0 * estimate["std"], (answer, name)
    assert told >= 16  # of 24: poor runs tell less


def test_the_bench_reads_a_recordings_time_and_resolution(suite: Path) -> None:
    recording = read_recording(suite / "out" / "0001.parquet")
    scenario = parse(answers_in(suite / "answers")[0]["scenario"], "answer")
    assert recording.summary.T_s == pytest.approx(scenario.drive.T_s)
    assert recording.summary.left_out == 0
    assert recording.runs[0].resolution.i == pytest.approx(scenario.drive.i_full / 32767.0, rel=1e-4)


def test_sizes_that_trip_the_drive_are_drawn_anew_and_given_up_in_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    def stray(low: float, high: float) -> Population:
        sizes = STRANGERS["stray_voltage"].sizes
        return Population("amplitude over u_dc", "1", low, high, "", sizes)

    monkeypatch.setitem(POPULATIONS, "stray_voltage", stray(0.01, 3.0))  # type: ignore[arg-type]
    choice = Choice(1, ("stray_voltage",), (0.0, 1.0), ("servo_4nm",), SHORTEST)
    anew = [concealed for concealed, _ in (drawn(choice, n) for n in range(1, 9)) if concealed.redrawn]
    assert anew
    for concealed in anew:
        none = drawn(Choice(1, ("none",), (0.0, 1.0), ("servo_4nm",), SHORTEST), concealed.number)[0]
        assert concealed.scenario.run == none.scenario.run  # sizes were drawn anew, the run was not
        assert drawn(choice, concealed.number)[0] == concealed
    monkeypatch.setitem(POPULATIONS, "stray_voltage", stray(5.0, 5.0))  # type: ignore[arg-type]
    with pytest.raises(TripError):
        recorded(replace(PAPER, effects=NONE._replace(stray=Stray(amplitude=300.0))), 300)
    with pytest.raises(ScenarioError, match="recording 1: none of 24 draws of stray_voltage is one that the drive"):
        drawn(choice, 1)


# --- Nothing but the signals tells a class


def kinds_of(answers: Sequence[dict[str, Any]]) -> list[str]:
    """None, an effect, or a stranger."""
    return [answer["kind"] if answer["kind"] in ("none", "stranger") else "effect" for answer in answers]


def test_nothing_outside_the_signals_tells_a_class(suite: Path) -> None:
    answers = answers_in(suite / "answers")
    features = [outside_of(suite / "out", answer["recording"]) for answer in answers]
    for labels in (kinds_of(answers), [answer["kind"] for answer in answers]):
        result = told_apart(features, labels)
        assert result.p > 0.01, result


def test_nothing_that_a_run_is_drawn_from_tells_a_class(suite: Path) -> None:
    answers = answers_in(suite / "answers")
    result = told_apart([findable(answer) for answer in answers], kinds_of(answers))
    assert result.p > 0.01, result


@pytest.mark.parametrize(
    "leak", ["a row less", "compressed", "later", "another encoder", "a note", "a finer converter"]
)
def test_the_same_classifier_finds_a_leak_that_is_planted(suite: Path, tmp_path: Path, leak: str) -> None:
    answers = answers_in(suite / "answers")
    features: list[Features] = []
    for answer in answers:
        told = outside_of(suite / "out", answer["recording"])
        if answer["kind"] == "stranger":
            told = planted(leak, suite / "out", answer["recording"], tmp_path)
        features.append(told)
    result = told_apart(features, kinds_of(answers))
    assert result.p <= 0.01, result


@pytest.mark.slow
def test_nothing_outside_the_signals_tells_one_effect_from_another(tmp_path: Path) -> None:
    made(
        "--count", "1500", "--seed", "5", "--out", tmp_path / "out", "--answers", tmp_path / "answers",
        "--length", str(SHORTEST), "--class", *POPULATIONS, "none",
    )  # fmt: skip
    # Means of samples have finer steps than a converter: physics of the signals
    answers = [each for each in answers_in(tmp_path / "answers") if "currents_averaged" not in each["classes"]]
    labels = ["".join(answer["classes"]) for answer in answers]
    assert len(set(labels)) == len(POPULATIONS)
    for features in (
        [outside_of(tmp_path / "out", answer["recording"]) for answer in answers],
        [findable(answer) for answer in answers],
    ):
        result = told_apart(features, labels)
        assert result.p > 0.01, result
    assert sum(answer["redrawn"] for answer in answers if not set(answer["classes"]) & set(CHAIN)) <= 3


@pytest.mark.slow
def test_every_class_runs_on_every_motor_at_its_largest_without_a_redraw() -> None:
    for name in POPULATIONS:
        for number, motor in enumerate(MOTORS):
            concealed, columns = drawn(Choice(2, (name,), (1.0, 1.0), (motor,), 0.5), number)
            # Current control that is tuned without the lag of a chain is too fast for a run or two
            assert concealed.redrawn == 0 or name in CHAIN, (name, motor)
            assert len(columns["t"]) > 0.9 * concealed.periods


# --- The command


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--count", "0"], "--count takes 1 to 100000, got 0"),
        (["--class", "one", "rust"], "got 'rust'"),
        (["--motor", "perpetuum"], "--motor takes motors of the catalogue, anaheim_bly172s"),
        (["--size", "0.5", "0.2"], "--size takes two numbers from 0 to 1, the lower one first, got 0.5 0.2"),
        (["--size", "0", "1.5"], "--size takes two numbers from 0 to 1, the lower one first, got 0 1.5"),
        (["--length", "0.01"], "--length takes 0.2 to 600 s, got 0.01 s"),
        (["--length", "nan"], "--length takes 0.2 to 600 s, got nan s"),
        (["--workers", "-1"], "--workers takes at least 1, or 0 for one per core, got -1"),
        (["--answers", "out/answers"], "--answers takes a folder outside --out, out, got out/answers"),
        (["--answers", "out"], "--answers takes a folder outside --out, out, got out"),
        (["--answers", "full"], "--answers takes a new or an empty folder, full has something in it"),
        (["--out", "full"], "--out takes a new or an empty folder, full has something in it"),
        (["--out", "full/file"], "--out takes a folder, full/file is a file"),
        (["--out", "full/file/below"], "cannot write full/file/below: Not a directory"),
    ],
)
def test_what_cannot_be_is_refused_in_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], arguments: list[str], said: str
) -> None:
    from emulator.conceal.command import main

    monkeypatch.chdir(tmp_path)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").touch()
    code = main(["--count", "1", "--seed", "1", "--out", "out", "--answers", "answers", *arguments])
    heard = capsys.readouterr().err.splitlines()
    assert code == (1 if "cannot write" in said else 2)
    assert heard[-1].startswith("emulator conceal: ")
    assert said in heard[-1]
    assert not (tmp_path / "out").exists()
    assert [path.name for path in (tmp_path / "full").iterdir()] == ["file"]


def test_classes_and_ranges_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    from emulator.conceal.command import main

    with pytest.raises(SystemExit) as ended:
        main(["--list"])
    assert not ended.value.code
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(POPULATIONS)
    assert lines[0] == (
        "dead_time            dead_time over T_s: 0.004 to 0.03 (0.2 us of small MOSFETs at 20 kHz to 3 us of IGBTs "
        "at 10 kHz)"
    )


@contextmanager
def many(folder: Path) -> Generator["subprocess.Popen[str]"]:
    """A suite under way that would take long, with a few recordings done."""
    process = conceal(
        "--count", "5000", "--seed", "1", "--out", folder / "out", "--answers", folder / "answers", "--length", "1",
        "--workers", "2",
    )  # fmt: skip
    try:
        deadline = time.monotonic() + READY
        while len(list((folder / "out").glob("*.parquet"))) < 4:
            assert process.poll() is None, process.communicate()
            assert time.monotonic() < deadline
            time.sleep(0.05)
        yield process
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()


@pytest.mark.parametrize(
    "how",
    ["Ctrl-C", *(pytest.param(how, marks=pytest.mark.slow) for how in ("SIGTERM", "a process killed"))],
)
def test_an_end_before_the_end_leaves_whole_recordings_with_their_answers(tmp_path: Path, how: str) -> None:
    with many(tmp_path) as process:
        if how == "Ctrl-C":  # which a terminal sends to all
            os.killpg(process.pid, signal.SIGINT)
        elif how == "SIGTERM":
            process.send_signal(signal.SIGTERM)
        else:
            os.kill(next(iter(_worker_times(process.pid))), signal.SIGKILL)
        _, said = process.communicate(timeout=60.0)
    killed = how == "a process killed"
    assert process.returncode == (1 if killed else 130)
    assert "Traceback" not in said
    why = "one of its processes was ended from outside" if killed else "interrupted"
    assert said.splitlines()[-1] == f"emulator conceal: {why}; what is in {tmp_path / 'out'} is whole"
    names = sorted(path.stem for path in (tmp_path / "out").glob("*.parquet"))
    assert len(names) >= 2  # of four that were begun by two processes
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == sorted(
        f"{name}.{end}" for name in names for end in ("parquet", "toml")
    )
    manifest = json.loads((tmp_path / "answers" / "manifest.json").read_text())
    assert [line["recording"] for line in manifest["recordings"]] == names
    for name in names:
        assert len(columns_of(tmp_path / "out" / f"{name}.parquet")["t"]) > 1000
        assert json.loads((tmp_path / "answers" / f"{name}.json").read_text())["recording"] == name


def test_the_processes_of_a_suite_end_with_the_one_that_started_them(tmp_path: Path) -> None:
    with many(tmp_path) as process:
        workers = _worker_times(process.pid)
        assert len(workers) == 2
        process.kill()
        process.wait()
        deadline = time.monotonic() + 60.0
        while any(Path(f"/proc/{pid}").exists() for pid in workers):
            assert time.monotonic() < deadline
            time.sleep(0.05)
        process.communicate()


def test_a_suite_is_made_by_both_cores_at_once(tmp_path: Path) -> None:
    with many(tmp_path) as process:
        before = _worker_times(process.pid)
        assert len(before) == 2
        deadline = time.monotonic() + 60.0
        while any(time_ <= before[pid] + 0.2 for pid, time_ in _worker_times(process.pid).items()):
            assert time.monotonic() < deadline
            time.sleep(0.05)


def _worker_times(parent: int) -> dict[int, float]:
    """Processor time (s) of a suite's processes."""
    times: dict[int, float] = {}
    for child in Path(f"/proc/{parent}/task/{parent}/children").read_text().split():
        if "spawn_main" in Path(f"/proc/{child}/cmdline").read_text():
            fields = Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()
            times[int(child)] = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return times
