"""The operator's page in headless Chromium against the real service and the emulated drive."""

from __future__ import annotations

import json
import re
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Protocol, cast
from urllib.parse import urlsplit

import pytest
from selenium.webdriver import Chrome
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.remote.webelement import WebElement
from selenium.webdriver.support.ui import WebDriverWait

from tests.browser.chromium import CHROMEDRIVER, CHROMIUM, chromium
from tests.conftest import bench_up
from tests.support.relay import relayed

PATIENCE_S = 45.0

# What the emulated motor can be, with room for temperature and saturation: SI minimum and maximum.
SANE = {"R_s": (0.5, 2.0), "L_d": (2e-3, 8e-3), "L_q": (3e-3, 12e-3), "psi_f": (0.06, 0.24)}
SETTINGS = (
    "method", "length", "longest", "periods_per_row", "estimated", "held", "forgetting_factor", "ekf",
)
PREFIX = {"m": 1e-3, "µ": 1e-6, "n": 1e-9, "k": 1e3, "": 1.0}
UNIT = {"R_s": "Ω", "L_d": "H", "L_q": "H", "psi_f": "Vs"}

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(
        not (CHROMIUM.exists() and CHROMEDRIVER.exists()),
        reason="needs Chromium: install the packages chromium and chromium-driver",
    ),
]


class Bench(Protocol):
    """A running service with the emulated drive."""

    @property
    def url(self) -> str: ...


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chrome]:
    logs = {"browser": "ALL", "performance": "ALL"}
    with chromium(tmp_path_factory.mktemp("chromium"), "window-size=1440,1000", logs=logs) as chrome:
        yield chrome


@pytest.fixture
def page(browser: Chrome, running_bench: Bench) -> Iterator[Chrome]:
    """The page, freshly opened, with a streaming drive and four estimates; the window is put back afterwards."""
    before = window(running_bench)
    forget_logs(browser)
    browser.get(running_bench.url)
    until(browser, lambda: text(browser, "link-state") == "streaming", "the link to be streaming")
    until(
        browser,
        lambda: all(tile(browser, name).get_attribute("data-status") == "ok" for name in SANE),
        "all four parameters to be estimated",
    )
    yield browser
    browser.get("about:blank")
    request(running_bench, "PUT", {setting: before[setting] for setting in SETTINGS})


def test_the_page_tells_an_operator_which_drive_it_shows_and_that_it_streams(page: Chrome) -> None:
    state = page.find_element(By.ID, "link").get_attribute("data-state")
    assert state == "streaming"
    assert text(page, "drive-name") == "emulated"
    page.find_element(By.CSS_SELECTOR, "nav [data-room=drive]").click()
    assert "canopen://" in text(page, "identity")
    assert re.match(r"\d+ Hz", text(page, "fact-rate"))
    assert not page.find_element(By.ID, "banner").is_displayed()


@pytest.mark.parametrize("name", list(SANE))
def test_a_tile_shows_value_unit_and_interval(page: Chrome, name: str) -> None:
    value, exact_unit = reading(page, name)
    low, high = SANE[name]
    assert low < value < high
    interval = tile(page, name).find_element(By.CLASS_NAME, "interval").text
    match = re.fullmatch(rf"± ([\d.]+) {exact_unit} \(95 %\)", interval)
    assert match, interval
    assert float(match[1]) > 0


def test_every_plot_draws_points_and_a_band(page: Chrome) -> None:
    count = "return document.getElementById(arguments[0]).data?.[arguments[1]]?.x?.length ?? 0"
    path = "return document.querySelector(`#${arguments[0]} .scatterlayer path.js-line`)?.getAttribute('d') ?? ''"
    for name in SANE:
        plot = f"plot-{name}"
        until(page, lambda plot=plot: run(page, count, plot, 1) > 4, f"points in {plot}")
        assert run(page, count, plot, 0) > 8
        assert "L" in run(page, path, plot)


def test_the_form_changes_the_length_of_the_window(page: Chrome, running_bench: Bench) -> None:
    before = window(running_bench)
    wanted = before["length"] + 500
    apply_length(page, str(wanted))
    until(page, lambda: message(page).get_attribute("data-mood") == "good", "the form to report success")
    after = window(running_bench)
    assert {setting: after[setting] for setting in SETTINGS} == {
        **{setting: before[setting] for setting in SETTINGS},
        "length": wanted,
    }


def test_a_bad_length_shows_the_services_sentence_and_changes_nothing(page: Chrome, running_bench: Bench) -> None:
    before = window(running_bench)
    detail = refusal(running_bench, {"length": 1})
    apply_length(page, "1")
    until(page, lambda: message(page).text == detail, f"the sentence {detail!r}")
    assert message(page).get_attribute("data-mood") == "bad"
    assert page.find_element(By.ID, "window-length").get_attribute("value") == "1"
    assert window(running_bench) == before


def test_snapshots_do_not_overwrite_what_the_operator_types(page: Chrome, running_bench: Bench) -> None:
    type_over(page.find_element(By.ID, "window-length"), "777")
    rows = content(page, "fact-rows")
    until(page, lambda: content(page, "fact-rows") != rows, "the next snapshot")
    assert page.find_element(By.ID, "window-length").get_attribute("value") == "777"
    page.find_element(By.ID, "window-discard").click()
    length = page.find_element(By.ID, "window-length").get_attribute("value")
    assert length == str(window(running_bench)["length"])


def test_a_parameter_can_be_held_at_a_typed_value_and_estimated_again(page: Chrome, running_bench: Bench) -> None:
    page.find_element(By.ID, "estimated-psi_f").click()
    type_over(page.find_element(By.ID, "held-psi_f"), "121,5")
    page.find_element(By.ID, "window-apply").click()
    until(page, lambda: tile(page, "psi_f").get_attribute("data-status") == "held", "the tile to say held")
    held = window(running_bench)
    assert held["held"]["psi_f"] == pytest.approx(0.1215)
    assert "psi_f" not in held["estimated"]
    assert reading(page, "psi_f")[0] == pytest.approx(0.1215)
    page.find_element(By.ID, "estimated-psi_f").click()
    page.find_element(By.ID, "window-apply").click()
    until(page, lambda: tile(page, "psi_f").get_attribute("data-status") == "ok", "the tile to say estimated")


@pytest.mark.parametrize(
    ("method", "shown", "status"),
    [
        ("wls", {"window-length", "window-periods"}, "From the last"),
        ("rls", {"forgetting-factor", "window-periods"}, "Recursion over"),
        ("ekf", {"ekf-preset", "ekf-noise_i", "held-R_s", "held-psi_f"}, "Kalman filter over"),
    ],
)
def test_a_method_is_chosen_with_the_settings_it_uses(
    page: Chrome, running_bench: Bench, method: str, shown: set[str], status: str
) -> None:
    other = "rls" if method == "wls" else "wls"
    request(running_bench, "PUT", {"method": other})
    until(page, lambda: chosen_method(page) == other, "the form to follow the service")
    choose(page, method)
    settings = ("window-length", "window-periods", "forgetting-factor", "ekf-preset", "ekf-noise_i", "held-R_s",
                "held-psi_f")
    assert {setting for setting in settings if page.find_element(By.ID, setting).is_displayed()} == shown
    assert window(running_bench)["method"] == other  # nothing is sent before it is applied
    rows = content(page, "fact-rows")
    until(page, lambda: content(page, "fact-rows") != rows, "the next snapshot")
    assert chosen_method(page) == method
    page.find_element(By.ID, "window-apply").click()
    until(page, lambda: text(page, "estimates-status").startswith(status), f"the page to say {status}")
    assert window(running_bench)["method"] == method
    until(page, lambda: tile(page, "R_s").get_attribute("data-status") == "ok", "the resistance to be estimated")
    low, high = SANE["R_s"]
    assert low < reading(page, "R_s")[0] < high
    held = tile(page, "psi_f").get_attribute("data-status") == "held"
    assert held == (method == "ekf")


def test_the_form_stays_where_it_is_while_estimates_begin_anew(page: Chrome, running_bench: Bench) -> None:
    run(page, """
        window.tops = new Set();
        const look = () => {
          tops.add(document.getElementById("window-form").getBoundingClientRect().top + scrollY);
          requestAnimationFrame(look);
        };
        look();
    """)
    for method, begun in (("rls", "Recursion over"), ("ekf", "Kalman filter over"), ("wls", "From the last")):
        request(running_bench, "PUT", {"method": method})
        until(page, lambda begun=begun: text(page, "estimates-status").startswith(begun), f"the page to say {begun}")
        until(page, lambda: tile(page, "R_s").get_attribute("data-status") == "ok", "the resistance to be estimated")
    assert len(run(page, "return [...tops]")) == 1


def test_the_data_may_choose_the_window_and_each_tile_says_how_long_it_is(page: Chrome, running_bench: Bench) -> None:
    page.find_element(By.ID, "window-auto").click()
    type_over(page.find_element(By.ID, "window-longest"), "3000")
    assert not page.find_element(By.ID, "window-length").is_displayed()
    page.find_element(By.ID, "window-apply").click()
    until(page, lambda: window(running_bench)["length"] == "auto", "the service to choose")
    assert window(running_bench)["longest"] == 3000
    for name in SANE:
        said = tile(page, name).find_element(By.CLASS_NAME, "basis")
        until(page, lambda said=said: re.fullmatch(r"from the last [\d.]+ m?s", said.text), f"the window of {name}")
    page.find_element(By.ID, "window-auto").click()
    page.find_element(By.ID, "window-apply").click()
    until(page, lambda: window(running_bench)["length"] == 1000, "a length again")
    until(page, lambda: tile(page, "R_s").find_element(By.CLASS_NAME, "basis").text == "", "the tiles to say no window")


def test_settings_of_recursion_and_filter_reach_the_service_in_si(page: Chrome, running_bench: Bench) -> None:
    choose(page, "rls")
    type_over(page.find_element(By.ID, "forgetting-factor"), "0,999")
    until(page, lambda: text(page, "forgetting-hint") == "remembers about 1.00 s", "how long it remembers")
    choose(page, "ekf")
    for key, typed in (("noise_i", "12,5"), ("omega_e", "500"), ("doubt", "20")):
        type_over(page.find_element(By.ID, f"ekf-{key}"), typed)
    type_over(page.find_element(By.ID, "held-L_q"), "6")
    page.find_element(By.ID, "window-apply").click()
    until(page, lambda: message(page).get_attribute("data-mood") == "good", "the form to report success")
    applied = window(running_bench)
    assert (applied["method"], applied["forgetting_factor"], applied["held"]["L_q"]) == ("ekf", 0.999, 0.006)
    assert {key: applied["ekf"][key] for key in ("noise_i", "lsb", "omega_e", "doubt")} == {
        "noise_i": 0.0125, "lsb": 0.009, "omega_e": 500.0, "doubt": 0.2,
    }
    type_over(page.find_element(By.ID, "ekf-omega_e"), Keys.DELETE)
    page.find_element(By.ID, "window-apply").click()
    until(page, lambda: window(running_bench)["ekf"]["omega_e"] is None, "the speed to be measured again")


def test_a_refused_method_setting_shows_the_services_sentence_and_stays_to_be_mended(
    page: Chrome, running_bench: Bench
) -> None:
    before = window(running_bench)
    detail = refusal(running_bench, {"forgetting_factor": 1.5})
    choose(page, "rls")
    type_over(page.find_element(By.ID, "forgetting-factor"), "1.5")
    page.find_element(By.ID, "window-apply").click()
    until(page, lambda: message(page).text == detail, f"the sentence {detail!r}")
    assert window(running_bench) == before
    assert chosen_method(page) == "rls"
    page.find_element(By.ID, "window-discard").click()
    assert chosen_method(page) == before["method"]


def test_methods_are_chosen_with_the_arrow_keys_and_every_field_has_a_name(page: Chrome) -> None:
    radio = page.find_element(By.CSS_SELECTOR, "input[value=wls]")
    radio.send_keys(Keys.ARROW_DOWN)
    assert chosen_method(page) == "rls"
    page.switch_to.active_element.send_keys(Keys.ARROW_DOWN)
    assert chosen_method(page) == "ekf"
    for field in page.find_elements(By.CSS_SELECTOR, "#window-form :is(input, select)"):
        if field.is_displayed():
            assert field.accessible_name, field.get_attribute("id")
    page.find_element(By.ID, "window-discard").click()


def test_the_page_reports_no_error_and_asks_no_other_host(page: Chrome, running_bench: Bench) -> None:
    until(page, lambda: run(page, "return 'data' in document.getElementById('plot-R_s')"), "a plot")
    assert [e["message"] for e in log(page, "browser") if e["level"] in {"SEVERE", "WARNING"}] == []
    service = urlsplit(running_bench.url).netloc
    asked = {urlsplit(address).netloc for address in requested(page)}
    assert asked == {service}


@pytest.mark.parametrize("method", ["wls", "rls", "ekf"])
@pytest.mark.parametrize("width", [390, 768, 1440])
def test_the_page_needs_no_horizontal_scrolling(page: Chrome, width: int, method: str) -> None:
    choose(page, method)
    metrics = {"width": width, "height": 844, "deviceScaleFactor": 1, "mobile": width < 600}
    page.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    fits = "return document.documentElement.scrollWidth <= arguments[0] && innerWidth === arguments[0]"
    until(page, lambda: run(page, fits, width), f"the page to fit {width} px")
    page.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_a_broken_connection_to_the_service_is_told_and_found_again(browser: Chrome, running_bench: Bench) -> None:
    with relayed(urlsplit(running_bench.url).port or 80) as wire:
        browser.get(f"http://127.0.0.1:{wire.port}/")
        until(browser, lambda: text(browser, "link-state") == "streaming", "the link to be streaming")
        wire.cut()
        until(browser, lambda: "Connection to the service lost since" in text(browser, "banner"), "the banner")
        until(browser, lambda: text(browser, "link-state") == "not known", "the link to be not known")
        assert "not live" in text(browser, "estimates-status")
        wire.mend()
        until(browser, lambda: not browser.find_element(By.ID, "banner").is_displayed(), "the banner to go")
        assert text(browser, "link-state") == "streaming"
        browser.get("about:blank")


STEADY = """
[motor]
R_s = 0.9664
L_d = 4.24e-3
L_q = 6.21e-3
psi_f = 0.12
n_p = 4
i_rated = 6.0
J = 1e-3
B = 1e-4
[excitation]
i_d_ref = -1.0
i_q_ref = 3.0
"""


NOTE = "return document.getElementById(arguments[0]).layout?.annotations?.[0]?.text ?? ''"
NOTHING = "no values are remembered"


NEWEST = """return Math.max(-Infinity, ...(document.getElementById(arguments[0]).data ?? [])
  .flatMap((trace) => trace.x.filter(Number.isFinite)))"""  # s before now
OLDEST = """return Math.min(...(document.getElementById('plot-L_d').data ?? [])
  .flatMap((trace) => trace.x.filter(Number.isFinite)))"""  # s before now


def nothing_new(browser: Chrome, plot: str) -> bool:
    """It says that there are no values, or shows those of the first moments alone."""
    return run(browser, NOTE, plot) == NOTHING or run(browser, NEWEST, plot) < -3.0


def test_a_page_that_is_opened_anew_sees_the_past(browser: Chrome) -> None:
    with bench_up() as bench:
        browser.get(bench.url)
        until(browser, lambda: (run(browser, OLDEST) or 0.0) < -6.0, "six seconds of L_d")
        browser.get("about:blank")
        opened = time.monotonic()
        browser.get(bench.url)
        until(browser, lambda: (run(browser, OLDEST) or 0.0) < -6.0, "the past")
        assert time.monotonic() - opened < 4.0
        browser.get("about:blank")


def test_what_several_parameters_cannot_be_told_for_is_said_once(browser: Chrome, tmp_path: Path) -> None:
    scenario = tmp_path / "steady.toml"
    scenario.write_text(STEADY, encoding="utf-8")
    with bench_up("--scenario", str(scenario)) as bench:
        browser.get(bench.url)
        told = "R_s, L_d, L_q and psi_f cannot be told apart here: i_d, i_q and speed are constant."
        until(browser, lambda: text(browser, "untold") == told, f"the sentence {told!r}")
        for name in SANE:
            assert tile(browser, name).get_attribute("data-status") == "not_told"
            assert tile(browser, name).find_element(By.CLASS_NAME, "reason").text == "as said below"
            until(browser, lambda plot=f"plot-{name}": nothing_new(browser, plot), "a plot without a new value")
        browser.get("about:blank")


def until(browser: Chrome, condition: Any, what: str) -> None:
    waiting = WebDriverWait(browser, PATIENCE_S, poll_frequency=0.1)
    waiting.until(lambda _: condition(), f"waited {PATIENCE_S:.0f} s for {what}")


def run(browser: Chrome, script: str, *arguments: object) -> Any:
    return browser.execute_script(script, *arguments)  # pyright: ignore[reportUnknownMemberType]


def text(browser: Chrome, element_id: str) -> str:
    return browser.find_element(By.ID, element_id).text


def content(browser: Chrome, element_id: str) -> str:
    """Also of what is in another room."""
    return (browser.find_element(By.ID, element_id).get_attribute("textContent") or "").strip()


def tile(browser: Chrome, name: str) -> WebElement:
    return browser.find_element(By.ID, f"tile-{name}")


def message(browser: Chrome) -> WebElement:
    return browser.find_element(By.ID, "form-message")


def reading(browser: Chrome, name: str) -> tuple[float, str]:
    """Value in SI and the unit as shown."""
    root = tile(browser, name)
    shown = root.find_element(By.CLASS_NAME, "value").text
    unit = root.find_element(By.CLASS_NAME, "value-unit").text
    assert unit.endswith(UNIT[name]), unit
    return float(shown) * PREFIX[unit.removesuffix(UNIT[name])], unit


def type_over(field: WebElement, content: str) -> None:
    field.send_keys(Keys.CONTROL, "a")
    field.send_keys(content)


def apply_length(browser: Chrome, content: str) -> None:
    type_over(browser.find_element(By.ID, "window-length"), content)
    browser.find_element(By.ID, "window-apply").click()


def choose(browser: Chrome, method: str) -> None:
    browser.find_element(By.CSS_SELECTOR, f"input[value={method}]").click()


def chosen_method(browser: Chrome) -> str | None:
    return browser.find_element(By.CSS_SELECTOR, "input[name=method]:checked").get_attribute("value")


def log(browser: Chrome, kind: str) -> list[dict[str, Any]]:
    """What the browser wrote since it was last asked."""
    return cast("list[dict[str, Any]]", browser.get_log(kind))  # pyright: ignore[reportUnknownMemberType]


def forget_logs(browser: Chrome) -> None:
    for kind in ("browser", "performance"):
        log(browser, kind)


def requested(browser: Chrome) -> list[str]:
    """Addresses the page asked for over the network, from the browser's own log."""
    events = [json.loads(entry["message"])["message"] for entry in log(browser, "performance")]
    sent = [event["params"] for event in events if event["method"] == "Network.requestWillBeSent"]
    addresses = [str(params["request"]["url"]) for params in sent]
    return [address for address in addresses if urlsplit(address).scheme in {"http", "https", "ws", "wss"}]


def window(bench: Bench) -> dict[str, Any]:
    return request(bench, "GET", None)


def refusal(bench: Bench, change: dict[str, Any]) -> str:
    """The sentence with which the service refuses a change of the window."""
    with pytest.raises(urllib.error.HTTPError) as refused:
        request(bench, "PUT", change)
    with refused.value as response:
        assert response.code == 422
        return json.load(response)["detail"]


def request(bench: Bench, method: str, body: dict[str, Any] | None) -> dict[str, Any]:
    data = None if body is None else json.dumps(body).encode()
    asked = urllib.request.Request(
        bench.url.rstrip("/") + "/api/drives/emulated/window",
        data,
        {"Content-Type": "application/json"},
        method=method,
    )
    with urllib.request.urlopen(asked, timeout=PATIENCE_S) as response:
        return json.load(response)
