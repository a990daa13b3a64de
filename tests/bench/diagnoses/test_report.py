"""The report: one page that needs nothing else, that says all a diagnosis says, and whose pictures are finite."""

import json
import re
from dataclasses import replace
from html import unescape
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pytest

from bench.diagnoses.report import report
from bench.diagnoses.report_figures import AFTER, BEFORE, WIDTH
from estimator.diagnosis.verdict import Candidate, Diagnosis
from tests.support.diagnoses import (
    ALL,
    AMBIGUOUS,
    CONVENTION,
    EXPLAINED,
    NO_MISMATCH,
    NOMINAL,
    NOTHING_TOLD,
    RECORDING,
)


class Page(HTMLParser):
    """A page's words, headings, addresses and pictures."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.words = ""
        self.headings = list[str]()
        self.addresses = list[str]()
        self.places = list[str]()
        self.figures: dict[str, Any] = {}
        self._open = list[str]()
        self._id = ""
        self.feed(text)
        assert not self._open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self._id = given.get("id") or ""
        self.addresses += [given[key] or "" for key in ("src", "href") if key in given]
        if tag == "div" and self._id:
            self.places.append(self._id)
        if tag not in ("meta", "br"):
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self._open[-1:] == ["script"]:
            if self._id == "figures":
                self.figures = json.loads(data, parse_constant=lambda name: pytest.fail(f"{name} in a picture"))
        elif self._open[-1:] != ["style"]:
            self.words += data
            if self._open[-1:] == ["h2"]:
                self.headings.append(data)


def page(diagnosis: Diagnosis) -> Page:
    return Page(report(diagnosis, RECORDING, NOMINAL))


@pytest.mark.parametrize("name", ALL)
def test_every_kind_of_diagnosis_has_a_page_that_needs_nothing_else(name: str) -> None:
    shown = page(ALL[name])
    assert shown.addresses == []
    assert ALL[name].sentence in shown.words
    assert name.replace("nothing told", "not enough excitation") in shown.words
    assert set(shown.places) == set(shown.figures)
    for remark in ALL[name].remarks:
        assert remark in shown.words
    for figure in shown.figures.values():
        assert figure["layout"]["width"] == WIDTH


def test_a_finding_tells_its_size_place_odds_and_what_it_was_read_as() -> None:
    words = page(EXPLAINED).words
    for said in (
        "inverter voltage error", "2.000 ± 0.030 us", "where a phase current changes sign", "distance -0.4 to 0.4",
        "92 % of the mismatch's energy in 12 % of the rows", "next over 1e12", "imbalance 3e11",
        "970 mohm", "2430 ± 20 mohm", "966.80 ± 0.40 mohm", "+1460 mohm by inverter voltage error", "2.40 kohm",
        "97.8 % of the mismatch's variance", "59990 of 60000 rows used, 6 s, control period 100 us",
    ):
        assert said in words, said


def test_what_cannot_be_told_comes_with_the_experiment_and_what_is_left_with_its_place() -> None:
    shown = page(AMBIGUOUS)
    for said in (
        "Iron loss or winding resistance drift?", "collinear to 0.99", "record 500 and 2000 rpm at the same currents",
        "speed 500, 2000 rpm; i_d 0, -1.8 A; i_q 3 A; for 6 s", "a 90 Hz voltage of 1.0 V", "700 mV rms",
    ):
        assert said in shown.words, said
    assert shown.headings.index("What is unexplained") < shown.headings.index("The mismatch in time")


def test_a_convention_alone_has_no_figures_before_it_was_undone_and_explains_no_variance() -> None:
    words = page(CONVENTION).words
    assert "16.5 V" in words
    assert words.count("16.5 V") == 1
    assert "variance is explained" not in words
    assert "once its convention is undone" in words
    assert "100 % of the mismatch's energy" not in words


def test_pictures_have_one_colour_for_before_and_one_for_after() -> None:
    figures = page(EXPLAINED).figures
    assert list(figures) == ["over-time", "map-0", "map-1", "stretch", "spectrum", "candidates"]
    lines = [line for figure in figures.values() for line in figure["data"] if line["type"] == "scatter"]
    assert {line["line"]["color"] for line in lines if line["name"] == "before"} == {BEFORE}
    assert {line["line"]["color"] for line in lines if line["name"] == "after"} == {AFTER}
    before, after = figures["map-0"]["data"]
    assert (before["z"][0][0], before["z"][1][0] > after["z"][1][0]) == (None, True)
    assert figures["map-0"]["layout"]["coloraxis"]["cmax"] == pytest.approx(np.nanmax(before["z"][1]), rel=1e-3)
    alone, final = figures["candidates"]["data"]
    assert alone["y"][-1] == "<b>✓ inverter voltage error</b>"
    assert (alone["x"][-1], alone["x"][0], final["x"][0]) == (12.0, -12.0, None)


def test_pictures_in_time_and_place_say_over_how_many_periods_they_are_means_and_have_the_floor_of_those() -> None:
    shown = page(EXPLAINED)
    floor = next(line for line in shown.figures["over-time"]["data"] if line["name"] == "noise floor")
    assert floor["y"] == [0.38, 0.38]  # not the 0.39 V of single periods
    assert "one step ahead, as means over 10 periods, d and q together" in shown.words
    assert "Rms of the residual, as means over 10 periods, by speed, rpm and i_q, A." in shown.words
    traces = EXPLAINED.traces
    assert traces is not None
    unknown = page(replace(EXPLAINED, traces=replace(traces, floor_V=None, periods=1)))
    assert [line["name"] for line in unknown.figures["over-time"]["data"]] == ["before", "after"]
    assert "as values of single periods" in unknown.words


def test_a_diagnosis_without_pictures_or_fit_leaves_them_out() -> None:
    assert page(NOTHING_TOLD).headings == ["Remarks on the recording", "The recording"]
    assert page(NOTHING_TOLD).figures == {}
    assert "What was left out" not in page(NO_MISMATCH).headings
    traces = EXPLAINED.traces
    assert traces is not None
    nothing = np.zeros(0)
    empty = replace(
        traces, t=nothing, before_V=nothing, after_V=nothing, window_t=nothing, window={}, window_i={},
        frequency=nothing, spectrum=(nothing, nothing), maps=(),
    )  # fmt: skip
    assert list(page(replace(EXPLAINED, traces=empty)).figures) == ["over-time", "candidates"]


def test_foreign_words_are_text() -> None:
    nasty = "<script>alert(1)</script>"
    (candidate, *_) = EXPLAINED.candidates
    odd = replace(
        EXPLAINED, sentence=nasty, remarks=(nasty,),
        candidates=(Candidate(nasty, candidate.log10_odds_alone, 1.0, chosen=True),),
    )  # fmt: skip
    text = report(odd, replace(RECORDING, path=f"{nasty}.csv"), NOMINAL)
    assert nasty not in text
    assert re.search(r"<title>(.*?)</title>", text)
    assert nasty in unescape(text)
    assert Page(text).words.count("alert(1)") == 3
