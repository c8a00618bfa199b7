"""Windows, simulated: an interpreter without the modules, flags and signals that only POSIX systems have.

It shows that nothing needs them on import and what is said where they are needed. It is no test on Windows itself.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from testing.short_suite import make_short_suite

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.posix import MissingModule, check_posix, import_posix, is_posix

pytestmark = [pytest.mark.slow, pytest.mark.costly_fixture]

WITHOUT_POSIX = """
import sys
BLOCKED = {"fcntl", "resource", "pwd", "grp", "termios", "pty", "tty", "syslog"}
def is_imported_by_click():  # which has a part of its own for Windows
    frame = sys._getframe(1)
    while frame is not None:
        if frame.f_globals.get("__name__", "").startswith("click."):
            return frame.f_globals["__name__"] == "click._termui_impl"
        frame = frame.f_back
    return False
class Block:
    def find_spec(self, name, path=None, target=None):
        if name in BLOCKED and not is_imported_by_click():
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return None
for name in BLOCKED:
    sys.modules.pop(name, None)
import os, signal, socket
delattr(socket, "MSG_DONTWAIT")
for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC", "O_DIRECTORY"):
    delattr(os, name)
for name in ("SIGKILL", "SIGHUP", "SIGXCPU", "SIGXFSZ", "SIGPIPE"):
    delattr(signal, name)
sys.meta_path.insert(0, Block())
"""
MAIN = WITHOUT_POSIX + "from mdrive_sumo.cli import main\nmain()\n"
NEEDS = "needs Linux; on Windows use WSL2"
AGENT = """
class Mine:
    label = "single"
    def __init__(self, config): ...
"""


def call(*words: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run((sys.executable, "-c", MAIN, *map(str, words)), capture_output=True, text=True, timeout=240)


@pytest.fixture(scope="module")
def suite(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_short_suite(tmp_path_factory.mktemp("windows") / "suite", "i02*", metres=4)


@pytest.fixture(scope="module")
def run(suite: Path) -> Path:
    done = call("eval", "--suite", suite, "--agent", "idm", "--out", suite.parent / "run")
    assert done.returncode == 0, done.stderr
    return suite.parent / "run"


def test_an_agent_in_process_drives_with_one_worker(run: Path) -> None:
    assert (run / "results.json").is_file()


REFUSED = {
    "workers": ("eval", "--agent", "idm", "--workers", "2"),
    "agent": ("eval", "--agent", "mine.py:Mine"),
    "verify": ("verify", "RUN"),
    "serve": ("serve",),
}
WORKING = {
    "runs": ("list", "runs", "FOLDER"),
    "view": ("view", "RUN", "--no-open"),
    "doctor": ("doctor", "--sandbox"),
}
COMMANDS = {**REFUSED, **WORKING}
ALL_IN_ONE = (
    WITHOUT_POSIX
    + """
import json
from click.testing import CliRunner
from mdrive_sumo.cli import main
for words in json.loads(sys.argv[1]):
    told = CliRunner().invoke(main, words)
    print(json.dumps([told.exit_code, told.stdout, told.stderr, type(told.exception).__name__]))
"""
)
Told = tuple[int, str, str, str]


@pytest.fixture(scope="module")
def told(suite: Path, run: Path) -> dict[str, Told]:
    """Exit code, output, errors and exception of each command, all called in one process."""
    (suite.parent / "mine.py").write_text(AGENT)
    places = {"mine.py:Mine": str(suite.parent / "mine.py:Mine"), "RUN": str(run), "FOLDER": str(run.parent)}
    more = {"eval": ("--suite", str(suite), "--out", str(suite.parent / "other"))}
    commands = [[*(places.get(word, word) for word in words), *more.get(words[0], ())] for words in COMMANDS.values()]
    done = subprocess.run(
        (sys.executable, "-c", ALL_IN_ONE, json.dumps(commands)), capture_output=True, text=True, timeout=240
    )
    assert done.returncode == 0, done.stderr
    return dict(zip(COMMANDS, map(json.loads, done.stdout.splitlines()), strict=True))


@pytest.mark.parametrize("name", REFUSED)
def test_the_rest_says_what_it_needs_in_one_sentence(name: str, told: dict[str, Told]) -> None:
    exit_code, _, errors, exception = told[name]
    assert (exit_code, exception) == (2, "SystemExit"), errors
    (line,) = [line for line in errors.splitlines() if NEEDS in line]
    assert line.startswith("Error: ")


def test_what_reads_a_run_works(run: Path, told: dict[str, Told]) -> None:
    for name in ("runs", "view"):
        exit_code, _, errors, _ = told[name]
        assert exit_code == 0, errors
    assert (run / "view" / "index.html").is_file()


def test_boxes_are_examined_without_a_traceback(told: dict[str, Told]) -> None:
    _, said, errors, _ = told["doctor"]
    assert NEEDS in said and not errors, errors


def test_every_module_of_the_library_is_imported_without_them() -> None:
    program = WITHOUT_POSIX + (
        "import pkgutil, importlib, mdrive_sumo\n"
        "for one in pkgutil.walk_packages(mdrive_sumo.__path__, 'mdrive_sumo.'):\n"
        "    left_out = ('.learning', '.scenarios', '__main__', '.host', '.stat_supervisor', 'dask_executor')\n"
        "    if not any(part in one.name for part in left_out):\n"
        "        importlib.import_module(one.name)\n"
    )
    done = subprocess.run((sys.executable, "-c", program), capture_output=True, text=True, timeout=240)
    assert done.returncode == 0, done.stderr


def test_a_missing_module_is_a_sentence_when_it_is_used() -> None:
    module = import_posix("no_such_posix_module")
    assert isinstance(module, MissingModule)
    with pytest.raises(InputError, match=r"no_such_posix_module\.flock: this needs Linux; on Windows use WSL2"):
        module.flock  # noqa: B018
    assert is_posix()
    check_posix("a box")
