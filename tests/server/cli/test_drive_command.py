"""`mdrive-sumo drive`: bad input costs one sentence; links, folders and settings of a drive."""

import builtins
import json
import shutil
import socket
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result
from testing.drive_fakes import make_setup

from mdrive_sumo.cli import main
from mdrive_sumo.core.errors import InputError
from server.cli import drive_command
from server.drive.drive_file import DRIVE_FILE, StoredDrive, load_drive, save_drive
from server.drive.drive_host import make_drive_folder
from server.drive.session_rules import SessionRules
from server.drive.simulation_process import SimulationEnded

SCENARIO = "i11_ins_sl_town"


def run(*words: object) -> Result:
    return CliRunner().invoke(main, ["drive", *map(str, words), "--no-open", "--port", "0"])


def read_refusal(done: Result) -> str:
    """The sentence of a refused command."""
    assert done.exit_code == 2, (done.output, done.exception)
    assert isinstance(done.exception, SystemExit)
    sentence = done.stderr.splitlines()[-1]
    assert sentence.startswith("Error: ")
    return sentence.removeprefix("Error: ")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ((), "expected a SCENARIO, found none; `mdrive-sumo list scenarios` shows them"),
        (("i11_ins_sl_twon",), "scenario 'i11_ins_sl_twon': expected the id of a scenario in a packaged suite, found"),
        ((SCENARIO, "--suite", "interdriv"), "suite 'interdriv': expected a folder or one of "),
        ((SCENARIO, "--cav", "3"), f"--cav: scenario {SCENARIO}: expected 0 to 2, found 3"),
        ((SCENARIO, "--others", "shering"), "--others: expected one of stationary, "),
        ((SCENARIO, "--others", "colmdriver"), "--others: expected one of stationary, "),
        ((SCENARIO, "--substitute", "human"), "--substitute: expected one of stationary, "),
        ((SCENARIO, "--on-disconnect", "wait"), "--on-disconnect: expected one of pause, stationary, "),
        ((SCENARIO, "--tick", "3"), "--tick: expected --from RUN with it, found none"),
        (
            (SCENARIO, "--from", "nowhere"),
            "run 'nowhere': expected a folder that `mdrive-sumo eval` has written, found no such",
        ),
        ((SCENARIO, "--agent-clock", "measured"), "No such option '--agent-clock'."),
        ((SCENARIO, "--comm", "loud"), "--comm: expected one of ideal, off, "),
        (
            (SCENARIO, "--public-url", "drive.example"),
            "--public-url: expected http(s)://HOST[:PORT], found 'drive.example'",
        ),
        ((SCENARIO, "--host", "203.0.113.7"), "drive: cannot listen on 203.0.113.7 port 0: "),
        (
            ("--resume", "nowhere"),
            f"--resume nowhere: expected a folder of `mdrive-sumo drive`, found none with {DRIVE_FILE}",
        ),
        (
            (SCENARIO, "--resume", "."),
            "--resume: expected neither SCENARIO nor its options with it: the folder has them",
        ),
        (("--seed", "3", "--resume", "."), "--resume: expected neither SCENARIO nor its options with it"),
        (("--comm", "off", "--resume", "."), "--resume: expected neither SCENARIO nor its options with it"),
    ],
)
def test_bad_input_is_one_sentence(words: tuple[str, ...], sentence: str) -> None:
    assert read_refusal(run(*words)).startswith(sentence)


def test_the_help_names_no_option_that_is_refused() -> None:
    shown = CliRunner().invoke(main, ["drive", "--help"]).output
    assert "--sensing" in shown and "--agent-clock" not in shown


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--cav", "ego_9"), "scenario i11_ins_sl_town: CAV: expected one of 0, 1, 2, found 'ego_9'"),
        # These go the same way as the first; worker/test_wrong_drives.py has their sentences without a process each.
        pytest.param(
            ("--cav", "1", "--cav", "1"), "CAVs of people: expected each once, found 1, 1", marks=pytest.mark.full
        ),
        pytest.param(
            ("--others", "idm"),
            "option substitutes: expected agents that need no other sensor than is on board, found",
            marks=pytest.mark.full,
        ),
        pytest.param(("--weather", "hail"), "weather: expected one of ", marks=pytest.mark.full),
    ],
)
def test_what_the_simulation_refuses_is_one_sentence(words: tuple[str, ...], sentence: str, tmp_path: Path) -> None:
    assert sentence in read_refusal(run(SCENARIO, "--out", tmp_path / "drive", *words))
    assert not (tmp_path / "drive" / DRIVE_FILE).exists()


@pytest.mark.slow
def test_a_taken_port_and_a_folder_that_cannot_be_made_are_one_sentence(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        done = CliRunner().invoke(main, ["drive", SCENARIO, "--no-open", "--port", str(port)])
        sentence = f"drive: cannot listen on 127.0.0.1 port {port}: Address already in use; choose another --port"
        assert read_refusal(done) == sentence
    (tmp_path / "file").write_text("")
    assert "Not a directory" in read_refusal(run(SCENARIO, "--out", tmp_path / "file" / "drive"))


def test_without_the_extra_it_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def fail(name: str, *rest: Any, **more: Any) -> Any:
        if name.startswith("uvicorn"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return real(name, *rest, **more)

    for name in ("server.cli.drive_command", "server.cli", "server.cli.serve_command"):
        monkeypatch.delitem(__import__("sys").modules, name, raising=False)
    monkeypatch.setattr(builtins, "__import__", fail)
    done = CliRunner().invoke(main, ["drive", SCENARIO])
    monkeypatch.undo()
    assert read_refusal(done) == "drive: expected the package uvicorn, found none; pip install '.[server]'"


def test_a_drive_is_read_back(tmp_path: Path) -> None:
    setup = replace(make_setup(tmp_path / "d", ("0", "2")), seed=7, from_run=tmp_path, from_tick=40, weather="night")
    drive = StoredDrive(setup, SessionRules(on_disconnect="sharing"))
    save_drive(drive)
    assert load_drive(tmp_path / "d") == drive


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda content: content[:30], "expected JSON, found none"),
        (lambda content: content.replace('"seed"', r'"\ud800"'), "expected JSON, found none"),
        (lambda content: content.replace("mdrive-sumo/drive-settings/1", "other/1"), "format: expected"),
        (lambda content: json.dumps({**json.loads(content), "seed": "x"}), "seed: expected a valid integer, found 'x'"),
        (lambda content: json.dumps({**json.loads(content), "more": 1}), "more: expected"),
        (
            lambda content: json.dumps({**json.loads(content), "options": {"comm": "{"}}),
            "options: expected those of an",
        ),
        *(
            (
                lambda content, comm=comm: json.dumps(
                    {**json.loads(content), "options": {"comm": comm, "agent_clock": "ideal"}}
                ),
                "options: expected those of an episode, found comm: expected a JSON object",
            )
            for comm in ("null", "[" * 3000)
        ),
        (lambda content: "\x00\xff", "expected"),
    ],
)
def test_a_damaged_settings_file_is_one_sentence(change: Any, sentence: str, tmp_path: Path) -> None:
    save_drive(StoredDrive(make_setup(tmp_path), SessionRules()))
    path = tmp_path / DRIVE_FILE
    path.write_text(change(path.read_text()), "latin-1")
    with pytest.raises(InputError) as raised:
        load_drive(tmp_path)
    assert str(raised.value).startswith(f"{path}: ")
    assert sentence in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("agent", "sentence"),
    [("nothing", "on_disconnect: expected one of pause, "), ("idm", "--on-disconnect: expected one of pause, sharing")],
)
def test_who_drives_for_the_lost_is_checked_in_a_settings_file_as_well(
    agent: str, sentence: str, tmp_path: Path
) -> None:
    save_drive(StoredDrive(make_setup(tmp_path), SessionRules(on_disconnect=agent)))
    assert sentence in read_refusal(CliRunner().invoke(main, ["drive", "--no-open", "--resume", str(tmp_path)]))


def test_a_simulation_that_ends_before_the_drive_has_begun_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def fail(*_: object) -> None:
        raise SimulationEnded("ended")

    monkeypatch.setattr("server.drive.drive_host.SimulationProcess.open", fail)
    sentence = read_refusal(run(SCENARIO, "--out", tmp_path / "drive"))
    assert sentence.startswith("drive: the simulation process has ended before the drive began; ")
    assert not (tmp_path / "drive").exists()


def test_a_full_disk_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("server.drive.drive_file.write_text", fail)
    with pytest.raises(InputError, match=r"cannot be written: No space left on device; --out names another folder$"):
        save_drive(StoredDrive(make_setup(tmp_path), SessionRules()))


def test_folders_of_drives_have_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    first = make_drive_folder(None, "x", 0)
    first.mkdir(parents=True)
    assert [first, make_drive_folder(None, "x", 0), make_drive_folder(None, "x", 4)] == [
        Path("runs/drive-x-1"),
        Path("runs/drive-x-2"),
        Path("runs/drive-x-seed4-1"),
    ]
    shutil.rmtree(first)


@pytest.mark.parametrize(
    ("host", "public", "url"),
    [
        ("127.0.0.1", None, "http://127.0.0.1:9"),
        ("::1", None, "http://[::1]:9"),
        ("localhost", "https://drive.example/", "https://drive.example"),
    ],
)
def test_links_begin_with_how_others_reach_the_server(host: str, public: str | None, url: str) -> None:
    assert drive_command.ServerPlace(host, None, public).find_url(9) == url


def test_with_an_entered_run_its_conditions_hold() -> None:
    sentence = "--comm: expected none with --from, which has the conditions of its run"
    assert read_refusal(run(SCENARIO, "--from", "nowhere", "--comm", "off")) == sentence
