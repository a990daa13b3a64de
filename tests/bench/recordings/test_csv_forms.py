"""CSVs as other tools write them: the values are those of the plain form, and what is no row is told."""

import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bench.errors import RecordingError
from bench.recordings.recording import open_recording
from tests.support.recordings import read_recording
from tests.support.tables import NAMES, ROWS, Lines, cells, expect, plain, text

TABLE = plain()
PLAIN = cells(TABLE)

Write = Callable[[str | bytes], Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def write_file(content: str | bytes) -> Path:
        path = tmp_path / "a.csv"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write_file


def refusal(path: Path, **options: object) -> str:
    with pytest.raises(RecordingError) as caught:
        read_recording(path, **options)
    said = str(caught.value)
    assert said.startswith(f"{path}: ") and "\n" not in said
    return said.removeprefix(f"{path}: ")


def german(lines: Lines) -> Lines:
    return [lines[0], *([cell.replace(".", ",") for cell in line] for line in lines[1:])]


# --- separators, decimal signs, encodings


def test_separators_are_told_by_the_rows(write: Write):
    for separator, name in ((";", "';'"), ("\t", "tabs"), ("|", "'|'")):
        expect(write(text(PLAIN, separator)), TABLE, f"the file has columns separated by {name}")
    assert read_recording(write(text(PLAIN))).summary.remarks() == ()


def test_decimal_commas_with_a_byte_order_mark_and_windows_line_ends(write: Write):
    for separator, end in ((";", "\r\n"), ("\t", "\n")):
        path = write("\ufeff" + text(german(PLAIN), separator, end))
        expect(path, TABLE, "decimal commas")


def test_quoted_cells_with_decimal_commas_between_commas(write: Write):
    quoted = [PLAIN[0], *([f'"{cell}"' for cell in line] for line in german(PLAIN)[1:])]
    expect(write(text(quoted)), TABLE, "decimal commas")


def test_utf_16_with_its_mark_is_read(write: Write):
    content = text(PLAIN, "\t").encode("utf-16")
    expect(write(content), TABLE, "text in utf-16")
    expect(write(gzip.compress(content)), TABLE, "text in utf-16")


@pytest.mark.parametrize("micro", ["\u00b5".encode("cp1252"), "\u00b5".encode(), "\u03bc".encode(), b"u"])
@pytest.mark.parametrize("column", [{}, {"t": "t [\u00b5s]"}, {"t": "t [\u03bcs]"}, {"t": "t[us]"}])
def test_micro_signs_of_any_kind_are_one(write: Write, micro: bytes, column: dict[str, str]):
    if micro == b"u" and "t [" in column.get("t", ""):
        column = {"t": "t [us]"}
    lines = [["t [?s]", *NAMES[1:]], *([str(k * 100), *line[1:]] for k, line in enumerate(PLAIN[1:]))]
    expect(write(text(lines).encode().replace(b"?", micro)), TABLE, "times 1e-06", mapping=column)


@pytest.mark.parametrize(("header", "row", "said"), [
    ("t;u_d;u_q;i_d;i_q;omega_e", "{};1;2;3;4;1,234", "expected a number, came '1,234': thousands are to stand"),
    ("t,u_d,u_q,i_d,i_q,omega_e", '{},1,2,3,4,"1,234"', "expected a number, came '1,234': thousands are to stand"),
    ("u_d;u_q;i_d;i_q;omega_e", "1;2;3;4;1,234", "'1,234': is it a decimal comma or one between thousands?"),
    ("t,u_d,u_q,i_d,i_q,omega_e", "{},1,2,3,4,5,5", "came 7: '0.0000,1,2,3,4,5,5'; 500 of 500 rows cannot be read"),
    ("t,u_d,u_q,i_d,i_q,omega_e,x,x", "{},1,2,3,4,5,6", "the header has 8 names, every row 7 cells: row 1: expected 8"),
    ("t,u_d,u_q,i_d,i_q,omega_e", "{},1,2,3,4,1,234", "are there commas in numbers beside commas between columns?"),
])  # fmt: skip
def test_numbers_that_can_be_read_in_two_ways_are_refused(write: Write, header: str, row: str, said: str):
    lines = [header, *(row.format(f"{k * 1e-4:.4f}") for k in range(500))]
    assert said in refusal(write("\n".join(lines) + "\n"), constants={} if "t" in header[:2] else {"T_s": 1e-4})


def test_points_beside_decimal_commas_are_no_numbers(write: Write):
    lines = german(PLAIN)
    lines[1:] = [[*line[:5], "1.234", line[6]] for line in lines[1:]]
    said = refusal(write(text(lines, ";")))
    assert said.startswith("column 'omega_e', row 1: expected a number, came '1.234': thousands are to stand without")


# --- what stands around the rows


@pytest.mark.parametrize("before", [
    "# bench run 12, PWM 20 kHz, supply 48 V\n# gains: {\"kp\":1.5,\"ki\":750}\n# \n",
    "Bench run 12\nDate: 2024-05-01, 12:00\nSample rate,10000\nGain,0.5\n\n",
    "Model,X1,,,,,\nRate,10000,,,,,\n,,,,,,\n",
])
def test_lines_before_the_header_are_passed(write: Write, before: str):
    expect(write(before + text(PLAIN)), TABLE, "the file has lines before the header: ")


def test_a_header_in_a_comment_is_the_header(write: Write):
    expect(write("# run 12\n# " + text(PLAIN)), TABLE)


@pytest.mark.parametrize("units", [
    ["s", "V", "V", "A", "A", "rad/s", "rad"], ["(s)", "(V)", "(V)", "(A)", "(A)", "(rad/s)", "(rad)"],
    ["[s]", "", "", "", "", "", "-"],
])
def test_a_row_of_units_is_no_row(write: Write, units: list[str]):
    expect(write(text([PLAIN[0], units, *PLAIN[1:]])), TABLE, "a row of units below the header")


def test_a_row_of_units_is_used(write: Write):
    lines = [[f"{float(line[0]) * 1e3:.1f}", line[1], str(1e3 * float(line[2])), *line[3:]] for line in PLAIN[1:]]
    units = ["ms", "V", "mV", "A", "A", "rad/s", "rad"]
    expect(write(text([PLAIN[0], units, *lines])), TABLE, "t is column 't', in ms: times 0.001", "u_q is column 'u_q'")
    units[3] = "LSB"
    path = write(text([PLAIN[0], units, *lines]))
    assert refusal(path).startswith("the row of units: i_d in 'LSB': expected one of A, mA, kA, uA, or what makes")
    expect(path, TABLE, mapping={"i_d": "i_d*1"})


@pytest.mark.parametrize("which", [range(ROWS + 1), range(1, ROWS + 1), range(1), range(2, ROWS, 3), [700]])
def test_separators_at_the_ends_of_lines_are_no_cells(write: Write, which: range | list[int]):
    lines = text(PLAIN).splitlines()
    for k in which:
        lines[k] += ","
    expect(write("\n".join(lines) + "\n"), TABLE)


# --- lines that are no rows


def test_lines_run_together_are_left_out_and_end_a_run(write: Write):
    lines = text(PLAIN).splitlines()
    lines[1000:1002] = [lines[1000][:25] + lines[1001][8:]]
    path = write("\n".join(lines) + "\n")
    expect(path, TABLE, "lines left out that cannot be read: 1 of 1999; row 1000: expected 7 cells, came ",
           "rows lost, by the times: 2", runs=(slice(0, 999), slice(1001, None)))  # fmt: skip
    with open_recording(path, chunk_rows=7) as reader:
        assert sum(len(chunk.samples) for chunk in reader) == 1998


def test_a_cell_that_is_no_number_costs_its_line_only(write: Write):
    lines = [*PLAIN]
    lines[50] = [*lines[50][:3], "1O5", *lines[50][4:]]
    said = "lines left out that cannot be read: 1 of 2000; column 'i_d', row 50: expected a number, came '1O5'"
    expect(write(text(lines)), TABLE, said, "rows lost, by the times: 1", runs=(slice(0, 49), slice(50, None)))


def test_the_header_again_is_no_row_and_none_is_lost(write: Write):
    path = write(text([*PLAIN[:1001], PLAIN[0], *PLAIN[1001:]]))
    expect(path, TABLE, "that are the header again: 1", runs=(slice(0, 1000), slice(1000, None)))
    assert read_recording(path).summary.lost_rows == 0


@pytest.mark.parametrize("cut", [2, 3, 9, 20, 40])
def test_a_last_line_that_is_cut_is_left_out_wherever_it_is_cut(write: Write, cut: int):
    said = "the last line is cut short and left out: row 2000: expected "
    expect(write(text(PLAIN)[: -cut]), TABLE, said, runs=(slice(0, -1),))


def test_a_whole_last_line_needs_no_end(write: Write):
    expect(write(text(PLAIN)[:-1]), TABLE)


def test_a_file_with_many_lines_that_cannot_be_read_is_refused(write: Write):
    lines = text(PLAIN).splitlines()
    for k in range(50, ROWS, 50):
        lines[k] = lines[k][:20]
    assert refusal(write("\n".join(lines) + "\n")).endswith("; 39 of 2000 rows cannot be read")


def test_long_files_are_read_across_blocks_with_lines_that_are_no_rows(write: Write):
    n = 60_000
    lines = [list(NAMES), *([f"{k * 1e-4:.4f}", f"{k}", "1", "2", "3", "50", "0"] for k in range(n))]
    for k in (5, 31_000, 59_990):
        lines[k] = ["?"]
    recording = read_recording(write(text(lines)))
    assert [len(run) for run in recording.runs] == [4, 30_994, 28_989, 10]
    assert recording.summary.lost_rows == 3
    kept = np.delete(np.arange(float(n)), [4, 30_999, 59_989])
    assert np.array_equal(np.concatenate([run.u_d for run in recording.runs]), kept)


def test_rows_after_a_line_that_cannot_be_read_are_called_by_their_place(write: Write):
    lines = [*PLAIN]
    lines[10], lines[21] = ["?"], ["0.0001", *lines[21][1:]]
    assert refusal(write(text(lines))).startswith("row 21: time runs backwards")
