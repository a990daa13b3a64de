"""The report: one page that needs nothing else, no script either, and that says and shows all a diagnosis does."""

import re
from dataclasses import replace
from html import unescape
from html.parser import HTMLParser

import numpy as np
import pytest

from bench.diagnoses.figures.pictures import pictures
from bench.diagnoses.report.page import POLICY
from estimator.diagnosis.verdict import Candidate, Diagnosis
from tests.support.diagnoses import (
    ALL,
    AMBIGUOUS,
    CONVENTION,
    EXPLAINED,
    NO_MISMATCH,
    NOTHING_TOLD,
    RECORDING,
    page_of,
)

MOST = 300_000  # bytes of a page with every picture


class Page(HTMLParser):
    """A page's words, headings, addresses and pictures."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.words = ""
        self.headings = list[str]()
        self.addresses = list[str]()
        self.tags = set[str]()
        self.figures = list[str]()
        self.labels = list[str]()  # of pictures
        self.policy = ""
        self._open = list[str]()
        self.feed(text)
        assert not self._open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.tags.add(tag)
        self.addresses += [given[key] or "" for key in ("src", "href") if key in given]
        assert "style" not in given
        assert not [key for key in given if key.startswith("on")]
        if tag == "figure":
            self.figures.append(given["id"] or "")
        if tag == "svg":
            assert given["role"] == "img"
            self.labels.append(given["aria-label"] or "")
        if given.get("http-equiv") == "Content-Security-Policy":
            self.policy = given["content"] or ""
        if tag not in ("meta", "br"):
            self._open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self._open[-1:] != ["style"]:
            self.words += data
            if self._open[-1:] == ["h2"]:
                self.headings.append(data)


def page(diagnosis: Diagnosis) -> Page:
    return Page(page_of(diagnosis))


@pytest.mark.parametrize("name", ALL)
def test_every_kind_of_diagnosis_has_a_page_that_needs_nothing_else(name: str) -> None:
    shown = page(ALL[name])
    assert shown.addresses == []
    assert ALL[name].sentence in shown.words
    assert name.replace("nothing told", "not enough excitation") in shown.words
    assert shown.policy == POLICY
    assert not shown.tags & {"script", "link", "img", "iframe", "object", "base"}
    for remark in ALL[name].remarks:
        assert remark in shown.words


@pytest.mark.parametrize("name", ALL)
def test_every_picture_is_on_the_page_in_two_widths_with_its_caption_and_the_page_is_small(name: str) -> None:
    text, drawn = page_of(ALL[name]), pictures(ALL[name])
    shown = Page(text)
    assert shown.figures == [figure.name for figure in drawn]
    assert shown.labels == [figure.caption for figure in drawn for _ in ("wide", "narrow")]
    assert len(text.encode()) < MOST
    assert not re.search(r"\b(nan|inf)\b", text[text.index("<body>") :], re.IGNORECASE)


def test_a_finding_tells_its_size_place_odds_and_what_it_was_read_as() -> None:
    words = page(EXPLAINED).words
    for said in (
        "inverter voltage error", "2.000 ± 0.059 us", "where a phase current changes sign", "distance -0.4 to 0.4",
        "92 % of the mismatch's energy in 12 % of the rows", "next over 1e12", "imbalance 3e11",
        "970 mohm", "2430 ± 39 mohm", "966.80 ± 0.78 mohm", "+1460 mohm by inverter voltage error", "2.40 kohm",
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


def test_a_diagnosis_without_pictures_or_fit_leaves_them_out() -> None:
    assert page(NOTHING_TOLD).headings == ["Remarks on the recording", "The recording"]
    assert page(NOTHING_TOLD).figures == []
    assert "What was left out" not in page(NO_MISMATCH).headings
    traces = EXPLAINED.traces
    assert traces is not None
    nothing = np.zeros(0)
    empty = replace(
        traces, t=nothing, before_V=nothing, after_V=nothing, window_t=nothing, window={}, window_i={},
        frequency=nothing, spectrum=(nothing, nothing), maps=(),
    )  # fmt: skip
    assert page(replace(EXPLAINED, traces=empty)).figures == ["over-time", "candidates"]


def test_foreign_words_are_text() -> None:
    nasty = "<script>alert(1)</script>"
    (candidate, *_) = EXPLAINED.candidates
    odd = replace(
        EXPLAINED, sentence=nasty, remarks=(nasty,),
        candidates=(Candidate(nasty, candidate.log10_odds_alone, 1.0, chosen=True),),
    )  # fmt: skip
    text = page_of(odd, recording=replace(RECORDING, path=f"{nasty}.csv"))
    assert nasty not in text
    assert re.search(r"<title>(.*?)</title>", text)
    assert nasty in unescape(text)
    assert "script" not in Page(text).tags
