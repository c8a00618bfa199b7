"""Everything that leaves a run: no absolute path, no user name, no host name (double-blind reviews)."""

import json
import re
import shutil
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from testing.short_suite import make_short_suite

from mdrive_sumo.cli import main
from mdrive_sumo.core.private_paths import (
    hide_command,
    hide_locator,
    hide_paths_in_text,
    relate_path,
    restore_locator,
    restore_path,
)
from mdrive_sumo.runs.fingerprint_paths import hide_paths, restore_paths
from mdrive_sumo.runs.journal import read_fingerprint

SECRET, USER, HOST = "alice-in-secret-lab", "user-alice", "host-of-alice"
AGENT = """
from pathlib import Path
from mdrive_sumo.contract import Control, Reply, SensorSpec

class Mine:
    label = "single"
    def __init__(self, config):
        assert Path(config["weights"]).read_text() == "weights", config
        self.ego = None
    def sensors(self): return (SensorSpec("objects"),)
    def start(self, briefing): self.ego = briefing.ego_id
    def act(self, seen):
        if seen.tick == 5: raise ValueError("lost in " + __file__)
        return Reply(control=Control(0.3, 0.0, 0.0))
"""


def call(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


@pytest.fixture(scope="module", autouse=True)
def names() -> Iterator[None]:
    """A machine and a user with names that are in no file by chance."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("socket.gethostname", lambda: HOST)
        patch.setattr("platform.node", lambda: HOST)
        for variable in ("USER", "LOGNAME", "LNAME", "USERNAME"):
            patch.setenv(variable, USER)
        yield


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project of its own in somebody's folder: suite, agent, weights; and a run with all of them."""
    folder = tmp_path_factory.mktemp("home") / SECRET / "project"
    folder.mkdir(parents=True)
    make_short_suite(folder / "suite", "i02*", metres=6)
    (folder / "mine.py").write_text(AGENT)
    (folder / "weights.bin").write_text("weights")
    (folder / "options.json").write_text(json.dumps({"weights": str(folder / "weights.bin")}))
    return folder


@pytest.fixture(scope="module")
def run(home: Path, in_process: None) -> Path:
    del in_process
    words = ("--suite", home / "suite", "--agent", f"{home}/mine.py:Mine", "--agent-config", home / "options.json")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["mdrive-sumo", "eval", *map(str, words), f"--out={home}/runs/one"])
        done = call("eval", *words, "--out", home / "runs" / "one")
    assert done.exit_code == 1, (done.output, done.exception)  # the agent has failed
    return home / "runs" / "one"


def find_private(data: bytes) -> list[str]:
    """Return what must not be in a file: the secret folder, absolute paths of homes and of tmp, user and host."""
    text = data.decode("utf-8", "replace")
    found = [word for word in (SECRET, USER, HOST) if word in text]
    return found + re.findall(r"(?:/home|/root|/tmp|/Users|/work)/[\w.-]+", text)


def read_files(folder: Path) -> Iterator[tuple[str, bytes]]:
    """Yield every file below a folder, and every member of archives. Output of the agent itself is left out."""
    for path in sorted(folder.rglob("*")):
        if not path.is_file() or path.parent.name == "logs":
            continue
        name = str(path.relative_to(folder))
        if zipfile.is_zipfile(path):
            with zipfile.ZipFile(path) as archive:
                yield from ((f"{name}/{member}", archive.read(member)) for member in archive.namelist())
        else:
            yield name, path.read_bytes()


def check(folder: Path) -> list[str]:
    """Return the names of the files after finding nothing private in any of them."""
    files = dict(read_files(folder))
    assert {name: found for name, data in files.items() if (found := find_private(data))} == {}
    return [*files]


@pytest.mark.slow
def test_the_files_of_a_run_and_its_pages(run: Path) -> None:
    assert call("view", run, "--no-open").exit_code == 0
    assert call("rescore", run, "--mode", "strict").exit_code in (0, 2)
    names = check(run)
    assert {"journal.jsonl", "results.json", "report.md", "view/index.html"} <= {*names}
    assert any(name.startswith("episodes/") for name in names)
    assert any(name.startswith("view/i02") for name in names)


@pytest.mark.slow
def test_reports_comparisons_exports_and_pictures(run: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["mdrive-sumo", "report", str(run), "--out", str(out / "report")])
        assert call("report", run, "--out", out / "report").exit_code == 0
    for name in ("csv", "fcd", "scenarionet"):
        done = call("export", run, "--format", name, "--out", out / name)
        assert done.exit_code == 0, done.output
    scenario = json.loads((run / "results.json").read_text())["scenarios"][0]["id"]
    drawn = call("render", run, "--scenario", scenario, "--tick", "3", "--out", out / "picture.png")
    assert drawn.exit_code == 0, drawn.output
    shown = call("show", scenario, "--suite", "interdrive@0", "--out", out / "map.svg")
    assert shown.exit_code == 0, shown.output
    assert len(check(out)) > 20


@pytest.mark.slow
def test_a_report_leads_to_replays_by_relative_links(
    run: Path, home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(home)
    assert call("report", "runs/one", "--out", "report", "--replays", "lost").exit_code == 0
    assert call("report", "runs/one", "--out", tmp_path / "elsewhere").exit_code == 0
    check(home / "report")
    check(tmp_path / "elsewhere")
    links = set(re.findall(r'href="([^"#]*/view/[^"]*)"', (home / "report" / "report.html").read_text()))
    assert links and all((home / "report" / link).is_file() for link in links)
    assert "/view/" not in (tmp_path / "elsewhere" / "report.html").read_text()


@pytest.mark.slow
def test_the_run_is_still_found_and_verified(run: Path, tmp_path: Path) -> None:
    assert read_fingerprint(run)["agent"] == "../../mine.py:Mine"
    assert read_fingerprint(run)["suite"] == "../../suite"
    assert json.loads(read_fingerprint(run)["agent_config"]) == {"weights": "run:../../weights.bin"}
    done = call("verify", run, "--trust-agent")
    assert done.exit_code == 0, done.output
    copied = tmp_path / "elsewhere" / "runs" / "one"  # the project, copied to another machine
    shutil.copytree(run.parents[1], tmp_path / "elsewhere")
    again = call("verify", copied, "--trust-agent")
    assert again.exit_code == 0, again.output


HOME = Path("/home/alice")


@pytest.mark.parametrize(
    ("path", "folder", "expected"),
    [
        ("/home/alice/p/my.py", "/home/alice/p/runs/x", "../../my.py"),
        ("/home/alice/p/runs/x/my.py", "/home/alice/p/runs/x", "./my.py"),
        ("/home/alice/agents/my.py", "/home/alice/p/runs/x", "../../../agents/my.py"),
        ("/home/alice/my.py", "/scratch/x", "./my.py"),
        ("/home/alice/my.py", "/home/bob/x", "./my.py"),
        ("/data/alice/my.py", "/data/runs/x", "./my.py"),
        ("/data/agents/my.py", "/data/runs/x", "../../agents/my.py"),
    ],
)
def test_a_relative_path_names_no_user(monkeypatch: pytest.MonkeyPatch, path: str, folder: str, expected: str) -> None:
    monkeypatch.setattr(Path, "home", lambda: HOME)
    assert relate_path(Path(path), Path(folder)) == expected


def test_locators_come_back(tmp_path: Path) -> None:
    folder = tmp_path / "runs" / "x"
    folder.mkdir(parents=True)
    (tmp_path / "my.py").touch()
    for name in (f"{tmp_path}/my.py:Mine", f"carla:{tmp_path}/my.py", f"carla-single:{tmp_path}/my.py"):
        hidden = hide_locator(name, folder)
        assert hidden.endswith(("../../my.py", "../../my.py:Mine"))
        assert restore_locator(hidden, folder) == name
    assert hide_locator(f"{tmp_path}/my.py:Mine") == "my.py:Mine"
    for name in ("idm", "perception-swap:attfuse:profile", "package.module:Class", "my.py:Mine"):
        assert hide_locator(name, folder) == name
        assert restore_locator(name, folder) == name


def test_a_file_of_which_only_the_name_is_known_is_found_in_the_present_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "my.py").touch()
    monkeypatch.chdir(tmp_path)
    assert restore_path("./my.py", tmp_path / "runs") == tmp_path / "my.py"
    assert restore_path("./other.py", tmp_path / "runs") == tmp_path / "runs" / "other.py"


def test_fingerprints_of_older_runs_stay_as_they_are(tmp_path: Path) -> None:
    old = {"suite": "/x/suite", "agent": "/x/my.py:Mine", "agent_config": '{"weights":"/x/w.bin"}'}
    assert restore_paths(old, tmp_path) == old
    named = {"suite": "interdrive", "agent": "idm", "agent_config": '{"speed":3}'}
    assert hide_paths(named, tmp_path) == restore_paths(named, tmp_path) == named


def test_commands_and_tracebacks_keep_names_only(tmp_path: Path) -> None:
    command = ("mdrive-sumo", "eval", f"--out={tmp_path}/r", "--agent", f"carla:{tmp_path}/a b.py", "--comm", "ideal")
    assert hide_command(command, tmp_path) == (
        *("mdrive-sumo", "eval", "--out=./r", "--agent", "carla:./a b.py", "--comm", "ideal"),
    )
    line = '  File "/home/alice/project/mine.py", line 7, in act'
    assert hide_paths_in_text(line) == '  File "mine.py", line 7, in act'
    assert hide_paths_in_text("1 m/s, 3/4, https://example.org/a and 5 / 6") == (
        "1 m/s, 3/4, https://example.org/a and 5 / 6"
    )
