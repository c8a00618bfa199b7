"""Mistakes on the command line: each gets one sentence with a remedy, and none writes a file."""

from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from click.testing import CliRunner, Result

from mdrive_sumo.cli import main
from mdrive_sumo.roads import find_network_folder

NETWORK = str(find_network_folder("boulevard"))
AGENT_FILE = """
class Careful:
    label = "single"
    def __init__(self, config): pass
    def sensors(self): return ()
    def start(self, briefing): pass
    def act(self, seen): raise ValueError("no idea")
class Unlabelled(Careful):
    label = None
class Needy(Careful):
    def __init__(self, config):
        self.speed = config["speed"]
"""


@pytest.fixture
def empty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty current folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*words: str) -> Result:
    return CliRunner().invoke(main, words)


def walk(command: click.Command, *words: str) -> Iterator[tuple[str, ...]]:
    """Yield the words of a command and of all below it."""
    yield words
    if isinstance(command, click.Group):
        context = click.Context(command)
        for name in command.list_commands(context):
            child = command.get_command(context, name)
            assert child is not None
            yield from walk(child, *words, name)


@pytest.mark.slow
def test_help_of_every_command_writes_nothing(empty: Path) -> None:
    commands = list(walk(main))
    assert ("admin", "team", "create") in commands and ("study", "comm") in commands and len(commands) > 40
    for words in commands:
        found = run(*words, "--help")
        assert found.exit_code == 0 and "Usage:" in found.output, (words, found.output)
        assert list(empty.iterdir()) == [], words


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("evl",), "expected a command, found 'evl'; did you mean 'eval'?"),
        (("eval", "--agent", "idmm"), "found neither; did you mean 'idm'?"),
        (("eval", "--suite", "interdrve"), "found neither; did you mean 'interdrive'?"),
        (
            ("eval", "--suite", "interdrive@0", "--scenario", "i11_ins_sl_twn"),
            "found none; did you mean 'i11_ins_sl_town'?",
        ),
        (
            ("eval", "--suite", "interdrive@0", "--scenario", "i11*", "--scenario", "zz"),
            "like 'zz', found none; `mdrive-sumo list scenarios",
        ),
        (("eval", "--sensing", "perfct"), "found 'perfct'; did you mean 'perfect'?"),
        (("eval", "--comm", "Realistic"), "found 'Realistic'; did you mean 'realistic'?"),
        (("eval", "--seed", "1", "--seed", "2"), "--seed: expected at most once, found it again"),
        (("study", "comm", "--agents", "idm", "--out", "o", "--comm", "idael", "--loss", "0"), "did you mean 'ideal'?"),
        (("study", "comm", "--agents", "idm", "--out", "o", "--grid", "ful"), "did you mean 'full'?"),
        (("schema", "result"), "found 'result'; did you mean 'results'?"),
        (("view", "nosuchrun"), "found no such folder; `mdrive-sumo eval` makes one"),
        (("compare", "a", "b"), "run 'a': expected a folder that `mdrive-sumo eval` has written, found no such folder"),
        (("show", "runs/nosuch"), "run 'runs/nosuch': expected a folder"),
        (("show", NETWORK, "--captured"), "show --captured: expected the folder of a finished run, found"),
        (
            ("show", "--suite", "interdrive@0", "i11*", "i12*", "--out", "x.png"),
            "expected one SCENARIO or RUN with them, found 2",
        ),
        (("view", "r", "--scenario", "a", "--scenario", "b", "--export", "x"), "expected one --scenario with it"),
        (("show", "--suite", "interdrive@0", "i11_ins_sl_twn"), "did you mean 'i11_ins_sl_town'?"),
        (
            ("list", "agents", "there"),
            "DIR: expected only with `list runs` and `list networks`, found 'there' with `list agents`",
        ),
        (("admin", "team", "create", ""), "name of a team: expected 1 to 64 printable characters, found ''"),
        (("admin", "team", "list"), "found none; --data or --settings says where it is"),
        (("admin", "token", "issue"), "found none; --data or --settings says where it is"),
        (("admin", "phase", "apply"), "expected settings with phases, found none"),
        (("admin", "environment", "build", "nope"), "environment: expected one of"),
        (("submit", "nosuch", "--dry-run", "--track", "singl-agent"), "did you mean 'single-agent'?"),
    ],
)
def test_a_mistake_gets_a_remedy_and_writes_nothing(empty: Path, words: tuple[str, ...], sentence: str) -> None:
    found = run(*words)
    assert found.exit_code == 2 and sentence in found.stderr.splitlines()[-1], found.output
    assert list(empty.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("eval", "--agent", "mine.py"), "without the name of its class; use mine.py:Careful"),
        (("eval", "--agent", "nix.py"), "expected path.py:Class, found no file 'nix.py'"),
        (("check", "mine.py"), "found a Python file; make a folder in which it is agents.py with a class Agent"),
    ],
)
def test_an_agent_file_gets_a_remedy(empty: Path, words: tuple[str, ...], sentence: str) -> None:
    (empty / "mine.py").write_text(AGENT_FILE)
    found = run(*words)
    assert found.exit_code == 2 and sentence in found.stderr, found.output


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("Carefull", "expected a class Carefull in mine.py, found none; did you mean 'Careful'?"),
        ("Needy", "cannot be created: KeyError: 'speed' (mine.py, line 12)"),
        ("Unlabelled", "agent Unlabelled: expected an attribute `label`, one of single, "),
    ],
)
def test_an_agent_class_gets_a_remedy(empty: Path, name: str, sentence: str) -> None:
    (empty / "mine.py").write_text(AGENT_FILE)
    found = run("eval", "--suite", "interdrive@0", "--scenario", "i11_ins_sl_town", "--agent", f"mine.py:{name}")
    assert found.exit_code == 2 and sentence in found.stderr, found.output


def test_a_number_that_is_none_names_its_option(empty: Path) -> None:
    ended = run("eval", "--pace", "nan")
    assert (ended.exit_code, "Invalid value for '--pace': expected a number" in ended.stderr) == (2, True)
    assert not [*empty.iterdir()]
