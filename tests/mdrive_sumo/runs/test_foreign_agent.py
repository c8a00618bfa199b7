"""A stranger's run folder names code: `verify` and `study ablate` ask before they run it, and say what it is."""

import os
import pty
import subprocess
import sys
from collections.abc import Generator
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from testing import suite_fakes
from testing.journals import rewrite_journal
from testing.paths import TESTS

from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.cli import main
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_job import replay_language_model
from mdrive_sumo.runs.foreign_agent import permit_agent
from mdrive_sumo.runs.stored_run import load_stored_run

pytestmark = pytest.mark.slow

AGENT = """
from pathlib import Path
from mdrive_sumo.contract import Control, Reply
(Path(__file__).parent / "was-run").touch()
class Driver:
    label = "single"
    def __init__(self, config): ...
    def sensors(self): return ()
    def start(self, briefing): ...
    def act(self, seen): return Reply(control=Control(throttle=0.5, brake=0.0, steer=0.0))
"""


def invoke(*words: str | int | Path) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of an agent of its own, without a simulation; the agent leaves a mark when it runs."""
    folder = tmp_path_factory.mktemp("made")
    suite_fakes.make_suite(folder / "suite", "answer")
    (folder / "mine.py").write_text(AGENT)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(TESTS))  # for the worker process
        patch.setattr("mdrive_sumo.runs.evaluate.run_job", suite_fakes.drive)
        options = ("--suite", folder / "suite", "--agent", f"{folder}/mine.py:Driver", "--workers", 1)
        ended = invoke("eval", *options, "--out", folder / "run")
    assert ended.exit_code == 0, ended.output
    return folder / "run"


@pytest.fixture
def run(made: Path) -> Generator[Path]:
    """The run; its journal and agent are restored after the test."""
    journal, agent = made / "journal.jsonl", made.parent / "mine.py"
    kept = journal.read_bytes()
    (made.parent / "was-run").unlink(missing_ok=True)
    yield made
    journal.write_bytes(kept)
    agent.write_text(AGENT)


@pytest.mark.parametrize("command", ["verify", "study ablate"])
def test_a_strangers_agent_does_not_run_unasked(run: Path, command: str) -> None:
    ended = invoke(*command.split(), run)
    assert ended.exit_code == 2
    assert ended.stderr.splitlines()[-1].startswith(
        f"Error: {run}: this would run the agent {run.parent}/mine.py:Driver (sha256 "
    )
    assert "--trust-agent" in ended.stderr and "--sandbox" in ended.stderr
    assert not (run.parent / "was-run").exists()


def test_a_module_is_not_even_imported(run: Path) -> None:
    """To look for `package.module` Python imports the package."""
    package = run.parent / "package"
    package.mkdir()
    (package / "__init__.py").write_text(AGENT)
    (package / "module.py").write_text(AGENT)
    rewrite_journal(run / "journal.jsonl", lambda line: line.replace("../mine.py:", "package.module:"))
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(run.parent))
        ended = invoke("verify", run)
    assert (ended.exit_code, "the agent package.module:Driver, a module that" in ended.stderr) == (2, True)
    assert not (package / "was-run").exists()


@pytest.mark.parametrize("permission", ["--trust-agent", "--sandbox"])
def test_an_agent_that_has_changed_is_said_first(run: Path, permission: str) -> None:
    path = run.parent / "mine.py"
    path.write_text(AGENT + "# edited\n")
    ended = invoke("verify", run, permission)
    assert ended.exit_code == 2
    assert ended.stderr.splitlines()[-1].startswith(f"Error: {run}: the agent has changed since this run: expected ")
    assert not (run.parent / "was-run").exists()
    path.unlink()
    ended = invoke("verify", run, permission)
    assert f"expected the run's agent at {path}, found no file; --agent PATH:CLASS says where" in ended.stderr


def test_an_agent_that_has_moved_is_found_where_the_user_says(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    moved = run.parent / "attic" / "renamed.py"
    moved.parent.mkdir()
    (run.parent / "mine.py").rename(moved)
    monkeypatch.chdir(moved.parent)
    stored = load_stored_run(run).run
    permitted = permit_agent(stored, trusted=True, place="renamed.py:Driver")
    assert permitted.config.agent.agent == f"{moved}:Driver"
    assert permit_agent(stored, sandbox=True, place=f"{moved}:Driver").config.sandbox
    with pytest.raises(InputError, match="found the built-in idm"):
        permit_agent(stored, trusted=True, place="idm")


def test_the_user_is_asked_and_can_refuse(run: Path) -> None:
    stored = load_stored_run(run).run
    asked: list[str] = []
    with pytest.raises(InputError, match="--trust-agent"):
        permit_agent(stored, ask=lambda text: bool(asked.append(text)))
    assert asked == [asked[0]] and asked[0].endswith("with all your permissions. Run it?")
    assert permit_agent(stored, ask=lambda _: True).config.agent == stored.config.agent


def test_on_a_terminal_the_question_stands_on_the_screen(run: Path) -> None:
    ours, theirs = pty.openpty()
    code = "from mdrive_sumo.cli import main; main()"
    command = [sys.executable, "-c", code, "verify", str(run)]
    with subprocess.Popen(command, stdin=theirs, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        os.write(ours, b"n\n")
        out, errors = process.communicate(timeout=120)
    os.close(ours)
    os.close(theirs)
    assert process.returncode == 2, out + errors
    assert "with all your permissions. Run it? [y/N]" in out
    assert not (run.parent / "was-run").exists()


def test_a_run_made_in_boxes_is_verified_in_boxes(run: Path) -> None:
    rewrite_journal(run / "journal.jsonl", lambda line: line.replace('"sandbox":false', '"sandbox":true'))
    assert permit_agent(load_stored_run(run).run).config.sandbox


def test_a_builtin_agent_needs_no_permission(run: Path) -> None:
    stored = load_stored_run(run).run
    rewrite_journal(run / "journal.jsonl", lambda line: line.replace("../mine.py:Driver", "idm"))
    assert not stored.config.agent.is_builtin
    stored = load_stored_run(run).run
    assert permit_agent(stored) is stored


def test_a_run_names_no_language_model_to_ask(tmp_path: Path) -> None:
    """An attack: the address of a stranger, and any environment variable as the key that is sent to it."""
    config = {"endpoint": "http://stranger.example/v1", "api_key_env": "HOME", "max_calls": 3}
    names = [name for name in AGENTS if name.startswith("colmdriver") and name != "colmdriver-rule"]
    for name in names:
        again = replay_language_model(AgentSpec(name, config), tmp_path / "none.jsonl")
        assert again.config == {"max_calls": 3, "talk": "endpoint", "transcript": os.devnull}
        AGENTS[name](again.config)
        gone = AgentSpec(name, {"transcript": str(tmp_path / "gone.jsonl")})
        assert replay_language_model(gone, None).config == {"transcript": os.devnull}
    assert replay_language_model(AgentSpec("idm"), None).config == {}
    (tmp_path / "t.jsonl").touch()
    again = replay_language_model(AgentSpec(names[0], config), tmp_path / "t.jsonl")
    assert again.config == {"max_calls": 3, "talk": "endpoint", "transcript": str(tmp_path / "t.jsonl")}
