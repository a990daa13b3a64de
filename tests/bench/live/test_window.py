"""The window's settings: every one that cannot work is a sentence, and none of those changes anything."""

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.errors import LimitError, shown
from bench.live.window import Window

WINDOW = Window(length=400, held={"psi_f": 0.12})
KEYS = "length, periods_per_row, estimated, held, method, longest, forgetting_factor or ekf"
ALL_HELD = {"R_s": 0.9664, "L_d": 4.24e-3, "L_q": 6.21e-3, "psi_f": 0.12}
TUNING = "preset, noise_i, lsb, omega_e, doubt, warming, model, P_0, Q, R or i_min"


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
        ({"size": 5}, f"expected {KEYS}, got 'size'"),
        ({"length": 3}, "window length must be 4 (4 parameters x 1 periods per row) to 1000000 samples, got 3"),
        ({"length": -5}, "window length must be 4 (4 parameters x 1 periods per row) to 1000000 samples, got -5"),
        ({"length": 1_000_001}, "window length must be 4 (4 parameters x 1 periods per row) to 1000000 samples, "
                                "got 1000001"),
        ({"held": {"L_d": 4.24}}, "held L_d: expected 1e-07 to 1 H (SI, per phase), got 4.24"),
        ({"length": 100.0}, 'length: expected a whole number or "auto", got 100.0'),
        ({"length": math.nan}, 'length: expected a whole number or "auto", got nan'),
        ({"length": True}, 'length: expected a whole number or "auto", got true'),
        ({"length": "100"}, 'length: expected a whole number or "auto", got \'100\''),
        ({"length": None}, 'length: expected a whole number or "auto", got null'),
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
        ({"held": {"R_s": True}}, "held R_s: expected a number of ohm above zero, got true"),
        ({"held": {"R_s": "0.9"}}, "held R_s: expected a number of ohm above zero, got '0.9'"),
        ({"held": {"R_s": None}}, "held R_s: expected a number of ohm above zero, got null"),
        ({"method": "kalman"}, "method: expected wls, rls or ekf, got 'kalman'"),
        ({"method": None}, "method: expected wls, rls or ekf, got null"),
        ({"method": ["wls"]}, "method: expected wls, rls or ekf, got ['wls']"),
        ({"method": "\udcff"}, r"method: expected wls, rls or ekf, got '\udcff'"),
        ({"length": "Auto"}, "length: expected a whole number or \"auto\", got 'Auto'"),
        ({"longest": "auto"}, "longest: expected a whole number, got 'auto'"),
        ({"longest": 3}, "longest: window length must be 4 (4 parameters x 1 periods per row) to 1000000 samples, "
                         "got 3"),
        ({"longest": 10**7}, "longest: window length must be 4 (4 parameters x 1 periods per row) to 1000000 samples, "
                             "got 10000000"),
        ({"forgetting_factor": 0.4999}, "forgetting_factor: expected a number of 0.99 to 1, got 0.4999"),
        ({"forgetting_factor": 1.5}, "forgetting_factor: expected a number of 0.99 to 1, got 1.5"),
        ({"forgetting_factor": math.nan}, "forgetting_factor: expected a number of 0.99 to 1, got nan"),
        ({"forgetting_factor": True}, "forgetting_factor: expected a number of 0.99 to 1, got true"),
        ({"forgetting_factor": "1"}, "forgetting_factor: expected a number of 0.99 to 1, got '1'"),
        ({"ekf": "tuned"}, "ekf: expected settings such as {\"preset\": \"tuned\"}, got 'tuned'"),
        ({"ekf": {"noise": 1}}, f"ekf: expected {TUNING}, got 'noise'"),
        ({"ekf": {"preset": "good"}}, "ekf preset: expected tuned, paper or custom, got 'good'"),
        ({"ekf": {"preset": "\udcff"}}, r"ekf preset: expected tuned, paper or custom, got '\udcff'"),
        ({"ekf": {"noise_i": 0}}, "ekf noise_i: expected a number of 1e-06 to 10000 A, got 0"),
        ({"ekf": {"noise_i": None}}, "ekf noise_i: expected a number of 1e-06 to 10000 A, got null"),
        ({"ekf": {"lsb": -1}}, "ekf lsb: expected a number of 0 to 10000 A, got -1"),
        ({"ekf": {"omega_e": -1}}, "ekf omega_e: expected a number of 0 to 100000 rad/s, got -1"),
        ({"ekf": {"doubt": 30}}, "ekf doubt: expected a number of 0.01 to 1, got 30"),
        ({"ekf": {"warming": math.inf}}, "ekf warming: expected a number of 0 to 1000 K/s, got inf"),
        ({"ekf": {"model": "flux"}}, "ekf model: expected inductances or fluxes, got 'flux'"),
        ({"ekf": {"model": "\udcff"}}, r"ekf model: expected inductances or fluxes, got '\udcff'"),
        ({"ekf": {"model": "inductances"}},
         "ekf: the states of model inductances are others than those of fluxes, so P_0 and Q are needed with it, "
         "got none"),
        ({"ekf": {"P_0": [1, 1, 1, 1]}}, "ekf P_0: expected a list of 5 numbers, got [1, 1, 1, 1]"),
        ({"ekf": {"P_0": [1, 1, 0, 1, 1]}}, "ekf P_0: expected a number of 1e-20 to 1e+06, got 0"),
        ({"ekf": {"Q": "11111"}}, "ekf Q: expected a list of 5 numbers, got '11111'"),
        ({"ekf": {"R": [0.1, "x"]}}, "ekf R: expected a number of 1e-12 to 1e+06, got 'x'"),
        ({"ekf": {"i_min": 0}}, "ekf i_min: expected a number of 1e-06 to 10000 A, got 0"),
        ({"method": "ekf"}, "method ekf starts from held values of R_s, L_d, L_q, psi_f, got none of R_s, L_d, L_q; "
                            "give those in held"),
        ({"method": "ekf", "estimated": ["psi_f"], "held": ALL_HELD},
         "method ekf estimates R_s, L_d, L_q and holds the rest, got psi_f"),
    ],
)
def test_a_setting_that_cannot_work_is_a_sentence(change: dict[str, Any], sentence: str) -> None:
    with pytest.raises(LimitError) as refused:
        WINDOW.changed(change)
    assert str(refused.value) == sentence


@pytest.mark.parametrize("number", [10**400, 10**5000, -(10**400)], ids=["large", "larger", "negative"])
@pytest.mark.parametrize("key", ["length", "periods_per_row", "held", "longest", "forgetting_factor"])
def test_numbers_beyond_all_measure_are_refused_in_a_short_sentence(key: str, number: int) -> None:
    with pytest.raises(LimitError) as refused:
        WINDOW.changed({key: {"R_s": number} if key == "held" else number})
    assert len(str(refused.value)) < 200


def test_a_setting_that_the_method_does_not_use_is_kept_for_when_it_does() -> None:
    window = WINDOW.changed({"held": ALL_HELD, "length": "auto", "longest": 5000})
    assert (window.samples, window.chosen_by_data) == (5000, True)
    window = window.changed({"method": "rls", "forgetting_factor": 0.999})
    assert not window.chosen_by_data
    window = window.changed({"method": "ekf", "ekf": {"noise_i": 0.02}}).changed({"ekf": {"preset": "paper"}})
    back = window.changed({"method": "wls", "ekf": {"preset": "tuned"}})
    assert (back.length, back.longest, back.chosen_by_data) == ("auto", 5000, True)
    assert (back.forgetting_factor, back.ekf.noise_i) == (0.999, 0.02)
    assert back.estimated == WINDOW.estimated


def test_the_longest_window_must_suit_the_rows_only_while_it_is_in_use() -> None:
    window = WINDOW.changed({"longest": 100}).changed({"periods_per_row": 50})
    with pytest.raises(LimitError, match=r"longest: window length must be 200 .* got 100"):
        window.changed({"length": "auto"})
    assert window.changed({"length": "auto", "longest": 200}).samples == 200


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.sampled_from(["auto", "ekf"]),
    lambda inner: st.lists(inner, max_size=6) | st.dictionaries(st.text(max_size=8), inner, max_size=3), max_leaves=6,
)
NEW_KEYS = st.sampled_from(["method", "length", "longest", "forgetting_factor", "ekf", "held"])
TUNING_KEYS = st.sampled_from(TUNING.replace(" or", ",").split(", "))


@given(st.dictionaries(NEW_KEYS, VALUES | st.dictionaries(TUNING_KEYS, VALUES, max_size=3), max_size=3))
def test_whatever_comes_is_settings_or_one_short_sentence(change: dict[str, Any]) -> None:
    try:
        window = WINDOW.changed(change)
    except LimitError as refused:
        assert 0 < len(str(refused)) < 300
        assert "\n" not in str(refused)
    else:
        assert 4 <= window.samples <= 1_000_000
        assert window.changed({}) == window


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
