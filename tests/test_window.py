"""The window's settings: every one that cannot work is a sentence, and none of those changes anything."""

import math
from typing import Any

import pytest

from bench.errors import LimitError, shown
from bench.window import Window

WINDOW = Window(length=400, held={"psi_f": 0.12})


def test_a_change_replaces_what_it_names_and_leaves_the_rest() -> None:
    changed = WINDOW.changed({"length": 900, "held": {"L_d": 4e-3}})
    assert changed == Window(900, 1, ("R_s", "L_d", "L_q", "psi_f"), {"psi_f": 0.12, "L_d": 4e-3})
    assert Window(400, held={"psi_f": 0.12}) == WINDOW
    assert WINDOW.changed({}) == WINDOW


def test_parameters_are_estimated_in_their_usual_order_and_once() -> None:
    assert WINDOW.changed({"estimated": ["L_q", "R_s", "L_q", "L_d"]}).estimated == ("R_s", "L_d", "L_q")


def test_a_window_may_be_as_short_as_its_parameters_and_rows_allow() -> None:
    change = {"estimated": ["R_s", "L_d", "L_q"], "periods_per_row": 5}
    assert WINDOW.changed(change | {"length": 15}).length == 15
    with pytest.raises(LimitError, match=r"length must be 15 \(3 parameters x 5 .*\) to 1000000 samples, got 14"):
        WINDOW.changed(change | {"length": 14})


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"size": 5}, "expected length, periods_per_row, estimated or held, got 'size'"),
        ({"length": 3}, "window length must be 4 (4 parameters x 1 periods per row) to 1000000 samples, got 3"),
        ({"length": -5}, "window length must be 4 (4 parameters x 1 periods per row) to 1000000 samples, got -5"),
        ({"length": 1_000_001}, "window length must be 4 (4 parameters x 1 periods per row) to 1000000 samples, "
                                "got 1000001"),
        ({"held": {"L_d": 4.24}}, "held L_d: expected 1e-07 to 1 H (SI, per phase), got 4.24"),
        ({"length": 100.0}, "length: expected a whole number, got 100.0"),
        ({"length": math.nan}, "length: expected a whole number, got nan"),
        ({"length": True}, "length: expected a whole number, got True"),
        ({"length": "100"}, "length: expected a whole number, got '100'"),
        ({"length": None}, "length: expected a whole number, got None"),
        ({"periods_per_row": 0}, "periods per row must be 1 to 1000, got 0"),
        ({"periods_per_row": 1001}, "periods per row must be 1 to 1000, got 1001"),
        ({"estimated": []}, "estimated: expected at least one of R_s, L_d, L_q, psi_f, got none"),
        ({"estimated": "R_s"}, "estimated: expected a list of R_s, L_d, L_q, psi_f, got 'R_s'"),
        ({"estimated": {"R_s": 1}}, "estimated: expected a list of R_s, L_d, L_q, psi_f, got {'R_s': 1}"),
        ({"estimated": ["R_s", "J"]}, "estimated: expected R_s, L_d, L_q, psi_f, got 'J'"),
        ({"estimated": [["R_s"]]}, "estimated: expected R_s, L_d, L_q, psi_f, got ['R_s']"),
        ({"estimated": ["R_s"]}, "L_d is not estimated, so a held value in H is needed, got none"),
        ({"held": [0.12]}, "held: expected values of R_s, L_d, L_q, psi_f, got [0.12]"),
        ({"held": {"J": 1.0}}, "held: expected R_s, L_d, L_q, psi_f, got 'J'"),
        ({"held": {"L_d": 0}}, "held L_d: expected a number of H above zero, got 0"),
        ({"held": {"R_s": -0.9}}, "held R_s: expected a number of ohm above zero, got -0.9"),
        ({"held": {"psi_f": math.nan}}, "held psi_f: expected a number of Vs above zero, got nan"),
        ({"held": {"psi_f": math.inf}}, "held psi_f: expected a number of Vs above zero, got inf"),
        ({"held": {"R_s": True}}, "held R_s: expected a number of ohm above zero, got True"),
        ({"held": {"R_s": "0.9"}}, "held R_s: expected a number of ohm above zero, got '0.9'"),
        ({"held": {"R_s": None}}, "held R_s: expected a number of ohm above zero, got None"),
    ],
)
def test_a_setting_that_cannot_work_is_a_sentence(change: dict[str, Any], sentence: str) -> None:
    with pytest.raises(LimitError) as refused:
        WINDOW.changed(change)
    assert str(refused.value) == sentence


@pytest.mark.parametrize("number", [10**400, 10**5000, -(10**400)], ids=["large", "larger", "negative"])
@pytest.mark.parametrize("key", ["length", "periods_per_row", "held"])
def test_numbers_beyond_all_measure_are_refused_in_a_short_sentence(key: str, number: int) -> None:
    with pytest.raises(LimitError) as refused:
        WINDOW.changed({key: {"R_s": number} if key == "held" else number})
    assert len(str(refused.value)) < 200


def test_a_foreign_value_is_shown_short_on_one_line_whatever_it_is() -> None:
    deep: list[Any] = []
    for _ in range(100_000):
        deep = [deep]
    assert shown("a\nb") == r"'a\nb'"
    assert shown("x" * 1000) == "'" + "x" * 76 + "..."
    assert shown(10**5000) == "something too long to show (int)"
    assert shown(deep) == "something too long to show (list)"
    while deep:
        deep = deep[0]  # freed step by step
