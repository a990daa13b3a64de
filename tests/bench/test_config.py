"""The configuration file: what it may say, and the sentence for everything else."""

import math
from pathlib import Path

import pytest

from bench.config import PORT_VARIABLE, emulated, load_config
from bench.errors import ConfigError
from bench.live.tuning import Tuning
from estimator.machine import PARAMETERS

URL = "canopen://socketcand/127.0.0.1:29536/can0/5"
DRIVE = f'[drives.a]\nurl = "{URL}"\n'


@pytest.fixture(autouse=True)
def no_port_variable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(PORT_VARIABLE, raising=False)


def written(folder: Path, text: str) -> Path:
    path = folder / "bench.toml"
    path.write_text(text, encoding="utf-8")
    return path


def sentence(folder: Path, text: str) -> str:
    """What is said of a file, without its name."""
    path = written(folder, text)
    with pytest.raises(ConfigError) as refused:
        load_config(path)
    said = str(refused.value)
    assert said.startswith(f"{path}: ")
    assert "\n" not in said
    assert len(said) < 400
    return said.removeprefix(f"{path}: ")


def test_a_file_that_says_everything_is_taken_as_it_says(tmp_path: Path) -> None:
    machine = "[machine]\nR_s = 0.5\npsi_f = 0.1\nn_p = 4\n[drive]\nencoder_counts = 8\n"
    (tmp_path / "spindle.toml").write_text(machine, encoding="utf-8")
    config = load_config(written(tmp_path, f"""
        [service]
        host = "0.0.0.0"
        port = 9000
        captures = "runs"
        journals = "flashed"
        log = "told"
        token = "secret"
        names = ["Bench.lan", "localhost:9000", "[fd00::5]"]
        certificate = "bench.pem"
        key = "bench.key"
        insecure = true
        [drives.spindle]
        url = "{URL}"
        machine = "spindle.toml"
        [drives.spindle.window]
        length = 500
        periods_per_row = 4
        estimated = ["L_q", "R_s", "L_d"]
        held = {{psi_f = 0.2}}
        [drives."Axis_2.left-hand"]
        url = "canopen://socketcan/vcan0/7"
    """))
    assert (config.host, config.port, config.captures) == ("0.0.0.0", 9000, tmp_path / "runs")
    assert config.journals == tmp_path / "flashed"
    assert (config.log, config.token, config.insecure) == (tmp_path / "told", tmp_path / "secret", True)
    assert config.names == ("bench.lan", "localhost:9000", "[fd00::5]")
    assert (config.certificate, config.key) == (tmp_path / "bench.pem", tmp_path / "bench.key")
    spindle, axis = config.drives
    assert (spindle.name, spindle.url) == ("spindle", URL)
    assert (spindle.window.length, spindle.window.periods_per_row) == (500, 4)
    assert spindle.window.estimated == ("R_s", "L_d", "L_q")
    assert spindle.window.held == {"R_s": 0.5, "psi_f": 0.2}
    assert spindle.nominal.theta_step == pytest.approx(math.pi)
    assert axis.name == "Axis_2.left-hand"
    assert axis.window.estimated == PARAMETERS


def test_method_and_its_settings_are_taken_as_the_file_says(tmp_path: Path) -> None:
    (tmp_path / "m.toml").write_text("[machine]\nR_s = 1\nL_d = 4e-3\nL_q = 6e-3\npsi_f = 0.1\n", encoding="utf-8")
    window = load_config(written(tmp_path, DRIVE + """
        machine = "m.toml"
        [drives.a.window]
        method = "ekf"
        length = "auto"
        longest = 5000
        forgetting_factor = 0.995
        [drives.a.window.ekf]
        noise_i = 0.02
        omega_e = 500
    """)).drives[0].window
    assert (window.method, window.length, window.longest, window.forgetting_factor) == ("ekf", "auto", 5000, 0.995)
    assert window.ekf == Tuning(noise_i=0.02, omega_e=500.0)


def test_a_url_alone_is_enough(tmp_path: Path) -> None:
    config = load_config(written(tmp_path, "\N{BYTE ORDER MARK}" + DRIVE))
    assert (config.host, config.port) == ("127.0.0.1", 8080)
    assert config.drives[0].window.length == 1000


def test_captures_go_among_the_users_data_unless_a_folder_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert emulated(URL).captures == load_config(written(tmp_path, DRIVE)).captures == tmp_path / "pmsm-bench/captures"
    monkeypatch.delenv("XDG_DATA_HOME")
    monkeypatch.setenv("HOME", "/home/ada")
    assert emulated(URL).captures == Path("/home/ada/.local/share/pmsm-bench/captures")


def test_the_built_in_configuration_is_the_emulated_motor() -> None:
    config = emulated(URL)
    (drive,) = config.drives
    assert (drive.name, drive.url, config.host, config.port) == ("emulated", URL, "127.0.0.1", 8080)
    assert drive.window.estimated == PARAMETERS


def test_the_environment_has_the_last_word_on_the_port(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(PORT_VARIABLE, "9123")
    assert load_config(written(tmp_path, "[service]\nport = 9000\n" + DRIVE)).port == 9123
    assert emulated(URL).port == 9123


@pytest.mark.parametrize("text", ["", "web", "-1", "65536", "80.5", "0x50", " 80", "٨٠", "9" * 5000])
def test_a_port_of_the_environment_that_is_none_is_named(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(PORT_VARIABLE, text)
    with pytest.raises(ConfigError, match=r"environment variable PMSM_BENCH_PORT: expected a port of 0 to 65535, got"):
        emulated(URL)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "expected at least one table [drives.NAME], got none"),
        ("[drives]\n", "expected at least one table [drives.NAME], got none"),
        ("drives = 5\n", "expected a table drives, got 5"),
        ("service = []\n" + DRIVE, "expected a table service, got []"),
        ("[server]\n" + DRIVE, "unknown key 'server', expected one of drives, service"),
        ("[service]\nprot = 1\n" + DRIVE,
         "[service]: unknown key 'prot', expected one of captures, certificate, database, host, insecure, "
         "journals, keep_free_megabytes, key, log, names, port, token"),
        ("[service]\nlog = 5\n" + DRIVE, "[service] log: expected a folder, got 5"),
        ('[service]\ntoken = ""\n' + DRIVE, "[service] token: expected a file name, got ''"),
        ('[service]\ntoken = "a\\u0000b"\n' + DRIVE, "[service] token: expected a file name, got 'a\\x00b'"),
        ("[service]\ninsecure = 1\n" + DRIVE, "[service] insecure: expected true or false, got 1"),
        ('[service]\nkey = "bench.key"\n' + DRIVE,
         "[service]: expected certificate and key, or neither, got key alone"),
        ('[service]\ncertificate = "bench.pem"\n' + DRIVE,
         "[service]: expected certificate and key, or neither, got certificate alone"),
        ('[service]\nnames = "bench.lan"\n' + DRIVE,
         "[service] names: expected a list such as [\"bench.lan\", \"localhost:9000\"], got 'bench.lan'"),
        ('[service]\nnames = ["http://bench.lan"]\n' + DRIVE,
         "[service] names: expected a list such as [\"bench.lan\", \"localhost:9000\"], got 'http://bench.lan'"),
        ("[service]\nhost = 5\n" + DRIVE, "[service] host: expected an address, got 5"),
        ('[service]\nhost = ""\n' + DRIVE, "[service] host: expected an address, got ''"),
        ("[service]\ncaptures = 5\n" + DRIVE, "[service] captures: expected a folder, got 5"),
        ('[service]\ncaptures = "bench.toml"\n' + DRIVE,
         "[service] captures: expected a folder, got 'bench.toml'; {folder}/bench.toml is none"),
        ('[service]\ncaptures = "bench.toml/a/b"\n' + DRIVE,
         "[service] captures: expected a folder, got 'bench.toml/a/b'; {folder}/bench.toml is none"),
        ("[service]\nport = 65536\n" + DRIVE, "[service] port: expected a port of 0 to 65535, got 65536"),
        ("[service]\nport = true\n" + DRIVE, "[service] port: expected a port of 0 to 65535, got true"),
        ('[service]\nport = "80"\n' + DRIVE, "[service] port: expected a port of 0 to 65535, got '80'"),
        ("[service]\nport = 0x" + "f" * 5000 + "\n" + DRIVE,
         "[service] port: expected a port of 0 to 65535, got something too long to show (int)"),
        ("[drives]\na = 5\n", "[drives.a]: expected a table a, got 5"),
        ('[drives."a/b"]\nurl = ""\n',
         "[drives]: expected names of letters, digits, '_', '.' and '-' that start with a letter or digit, got 'a/b'"),
        ('[drives.""]\n',
         "[drives]: expected names of letters, digits, '_', '.' and '-' that start with a letter or digit, got ''"),
        ("[drives.a]\n", '[drives.a]: expected url = "canopen://...", got null'),
        ("[drives.a]\nurl = 5\n", '[drives.a]: expected url = "canopen://...", got 5'),
        ('[drives.a]\nurl = "http://x"\n',
         "[drives.a] url: expected a drive URL that starts with canopen:// or modbus+tcp:// or modbus+rtu:// "
         "or uart://, got 'http://x'"),
        ('[drives.a]\nurl = "canopen://socketcand/h:0/can0/5"\n',
         "[drives.a] url: expected HOST:PORT with a port of 1 to 65535 in 'canopen://socketcand/h:0/can0/5', "
         "got 'h:0'"),
        (DRIVE + "uri = 1\n", "[drives.a]: unknown key 'uri', expected one of limits, machine, url, window"),
        (DRIVE + "machine = 5\n", "[drives.a] machine: expected a file name, got 5"),
        (DRIVE + "window = 5\n", "[drives.a]: expected a table window, got 5"),
        (DRIVE + "window.lenght = 5\n",
         "[drives.a] window: expected length, periods_per_row, estimated, held, method, longest, "
         "forgetting_factor or ekf, got 'lenght'"),
        (DRIVE + "window.length = 2\n",
         "[drives.a] window: window length must be 4 (4 parameters x 1 periods per row) to 1000000 samples, got 2"),
        (DRIVE + "window.estimated = []\n",
         "[drives.a] window: estimated: expected at least one of R_s, L_d, L_q, psi_f, got none"),
        (DRIVE + "window.held.R_s = nan\n",
         "[drives.a] window: held R_s: expected a number of ohm above zero, got nan"),
        (DRIVE + "window.held.R_s = -1\n",
         "[drives.a] window: held R_s: expected a number of ohm above zero, got -1"),
        (DRIVE + 'window.method = "ekf"\n',
         "[drives.a] window: method ekf starts from held values of R_s, L_d, L_q, psi_f, got none of R_s, L_d, L_q, "
         "psi_f; give those in held"),
        (DRIVE + "window.ekf.preset = 5\n",
         "[drives.a] window: ekf preset: expected tuned, paper or custom, got 5"),
        (DRIVE + f'[drives.b]\nurl = "{URL}"\n', "[drives.b] url: expected one of its own, got that of a"),
    ],
)
def test_what_is_wrong_in_a_file_is_named_with_its_key(tmp_path: Path, text: str, said: str) -> None:
    assert sentence(tmp_path, text) == said.replace("{folder}", str(tmp_path))


@pytest.mark.parametrize("text", ["port = ", "[a\n", "x = 1\nx = 2\n", "x = " + "[" * 5000, "x = " + "9" * 5000])
def test_what_is_no_toml_is_said_to_be_none(tmp_path: Path, text: str) -> None:
    assert sentence(tmp_path, text).startswith("not TOML: ")


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"absent\.toml: cannot be read: No such file or directory"):
        load_config(tmp_path / "absent.toml")
    with pytest.raises(ConfigError, match="cannot be read: Is a directory"):
        load_config(tmp_path)
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe\0")
    with pytest.raises(ConfigError, match=r"bytes\.toml: expected UTF-8 text, byte 0 is not"):
        load_config(tmp_path / "bytes.toml")


def test_the_machine_file_of_a_drive_is_named_when_it_is_the_one_that_is_wrong(tmp_path: Path) -> None:
    path = written(tmp_path, DRIVE + 'machine = "m.toml"\n')
    with pytest.raises(ConfigError, match=r"m\.toml: cannot be read"):
        load_config(path)
    (tmp_path / "m.toml").write_text("[machine]\nR_s = 0\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"m\.toml: \[machine\] R_s = 0: expected a finite number of ohm above zero"):
        load_config(path)
