"""Sets for other tools: read by those tools' own readers where there are some."""

import io
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import canopen
import pytest

from bench.errors import ConfigError
from bench.parameters.formats.a2l import as_a2l
from bench.parameters.formats.c_header import as_c_header
from bench.parameters.formats.dcf import as_dcf, from_dcf
from bench.parameters.parameter_set import ParameterSet, set_of
from drivers.wire.dictionary import signal_named

VALUES = {
    "n_p": 4.0, "control_R_s": 0.9664, "control_L_d": 4.24e-3, "bandwidth": 1250.0, "angle_offset": -0.25,
    "dead_time": 2e-6, "speed_error_time": 0.5, **{f"psi_d_table_{k}": 0.1 + 1e-3 * k for k in range(1, 65)},
}
SET = set_of(VALUES, "servo 6 A", "by hand")


def test_a_dcf_is_read_by_the_library_and_comes_back() -> None:
    text = as_dcf(SET)
    source: Any = io.StringIO(text)
    source.name = "drive.dcf"
    dictionary: Any = canopen.import_od(source)
    for name, value in VALUES.items():
        signal = signal_named(name)
        assert dictionary[signal.index][signal.subindex].value == pytest.approx(value)
    assert from_dcf(text, "again", "drive.dcf").values == VALUES


def test_what_is_wrong_in_a_dcf_is_told_at_once() -> None:
    text = as_dcf(SET).replace("ParameterValue=1250.0", "ParameterValue=1.0").replace("Value=0.9664", "Value=x")
    with pytest.raises(ConfigError) as told:
        from_dcf(text, "again", "drive.dcf")
    assert sorted(str(told.value).splitlines()) == [
        "drive.dcf: 0x2200:6 (bandwidth) takes at least 10.0 rad/s, got 1.0",
        "drive.dcf: [2200sub2] control_R_s: expected a number as ParameterValue, got 'x'",
    ]
    with pytest.raises(ConfigError, match=r"drive\.dcf: is no DCF"):
        from_dcf("bandwidth = 3", "again", "drive.dcf")
    with pytest.raises(ConfigError, match="got none"):
        from_dcf("[a]\nb=1\n", "again", "drive.dcf")
    assert from_dcf("[2200sub6]\nParameterValue=0x449C4000\n", "a", "b").values == {"bandwidth": 1250.0}


@pytest.mark.parametrize("form", ["float", "q15", "q31", "iq24"])
def test_a_header_compiles_and_its_counts_are_the_values(form: str, tmp_path: Path) -> None:
    compiler = shutil.which("gcc")
    if compiler is None:
        pytest.skip("no gcc")
    (tmp_path / "p.h").write_text(as_c_header(SET, form), encoding="ascii")
    one = "" if form == "float" else f" / {2.0 ** (int(form.strip('iq'))):.1f} * PMSM_BASE_"
    parts = {
        "bandwidth": "RAD_PER_S", "control_R_s": "OHM", "control_L_d": "H", "angle_offset": "RAD",
        "dead_time": "DEAD_TIME" if form in ("q15", "iq24") else "S", "speed_error_time": "S", "psi_d_table[63]": "VS",
    }
    prints = "".join(
        f'    printf("%.9g\\n", (double)pmsm_parameters.{name}{one}{unit if one else ""});\n'
        for name, unit in parts.items()
    )
    body = f"{prints}    return pmsm_parameters.n_p - PMSM_N_P;\n"
    (tmp_path / "p.c").write_text(f'#include "p.h"\n#include <stdio.h>\nint main(void) {{\n{body}}}\n')
    options = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-o", str(tmp_path / "p")]
    subprocess.run([compiler, *options, str(tmp_path / "p.c")], check=True)
    found = [float(x) for x in subprocess.run([tmp_path / "p"], check=True, capture_output=True).stdout.split()]
    fine = 1e-7 if form == "float" else 0.01
    assert found == pytest.approx([1250.0, 0.9664, 4.24e-3, -0.25, 2e-6, 0.5, 0.164], rel=fine)


def test_rounding_is_told_and_a_base_that_is_too_small_refused() -> None:
    assert "rounded by" in as_c_header(SET, "q15")
    assert "rounded by" not in as_c_header(SET)
    with pytest.raises(ConfigError, match="base of rad/s: expected more than 1250, the set's largest in q15, got 1000"):
        as_c_header(SET, "q15", {"rad/s": 1000.0})
    with pytest.raises(ConfigError, match="expected float, q15, q31 or iq1 to iq30, got 'q7'"):
        as_c_header(SET, "q7")
    for prefix in ("", "6_a", "a b", "a_", "a__b", "x" * 32):
        with pytest.raises(ConfigError, match="prefix: expected letters, digits and single _ between them, got"):
            as_c_header(SET, prefix=prefix)
    assert "#define SPINDLE_BANDWIDTH 1250.0f" in as_c_header(SET, prefix="spindle")
    for name in ("a */ b", "a **// int evil; /*", "a/*b"):
        assert re.fullmatch(r"/\* [^/]* \*/", as_c_header(ParameterSet(name, SET.entries)).splitlines()[0])


@pytest.mark.parametrize(("form", "most"), [("q15", 32767), ("q31", 2**31 - 1), ("iq24", 2**31 - 1)])
@pytest.mark.parametrize("value", [9.9999, 9.999999999, 0.99999, 127.999999999, 1e-9, 5000.0])
def test_no_count_turns_its_sign(form: str, most: int, value: float) -> None:
    text = as_c_header(set_of({"current_limit": value}, "a", "b"), form)
    count = re.search(r"#define PMSM_CURRENT_LIMIT (-?\d+) ", text)
    base = re.search(r"#define PMSM_BASE_\w+ (\S+) ", text)
    assert count is not None
    assert base is not None
    assert 0 < int(count[1]) <= most
    fraction = int(form.strip("iq"))
    assert int(count[1]) / 2.0**fraction * float(base[1]) == pytest.approx(value, rel=0.01)


def test_an_a2l_fragment_has_every_signal_and_its_blocks_end() -> None:
    text = as_a2l(SET)
    assert text.count("/begin") == text.count("/end")
    for name in ("bandwidth", "control_R_s", "psi_d_table"):
        assert f"/begin CHARACTERISTIC {name} " in text
    assert "VAL_BLK" in text
    assert "NUMBER 64" in text
