"""The gate fails where pytest alone would pass (tests/conftest.py); its sample of long tests names real tests."""

import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from testing.paths import ROOT, TESTS

pytestmark = pytest.mark.slow

OURS = [
    TESTS / "conftest.py",
    *(TESTS / "testing" / name for name in ("__init__.py", "paths.py", "shared_material.py")),
]


def session(folder: Path, body: str, *options: str, strict: bool = False) -> subprocess.CompletedProcess[str]:
    """Runs one test file under our conftest, two folders below `folder`: there is no ../shared/data."""
    tests = folder / "repository" / "tests"
    (tests / "testing").mkdir(parents=True, exist_ok=True)
    for file in OURS:
        shutil.copy(file, tests / file.relative_to(TESTS))
    (tests / "test_it.py").write_text(f"import pytest\n\n\n{body}\n")
    command = (sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *options, str(tests))
    environment = {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"} | ({"MDRIVE_STRICT_SKIPS": "1"} if strict else {})
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment)


@pytest.mark.parametrize(("strict", "refused"), [(True, {"needs Chromium", "no time"}), (False, {"no time"})])
def test_a_skip_needs_an_accepted_reason(tmp_path: Path, strict: bool, refused: set[str]) -> None:
    reasons = ("needs ../shared/data", "needs Chromium", "needs root", "no time")
    body = "\n\n\n".join(f"def test_{n}(): pytest.skip({reason!r})" for n, reason in enumerate(reasons))
    ended = session(tmp_path, body, strict=strict)
    assert ended.returncode == 1, ended.stdout
    assert set(re.findall(r"SKIPPED WITHOUT AN ACCEPTED REASON: .*: Skipped: (.*)", ended.stdout)) == refused


def test_a_skip_with_an_accepted_reason_passes(tmp_path: Path) -> None:
    assert session(tmp_path, "def test_it(): pytest.skip('needs root')", strict=True).returncode == 0


def test_data_that_is_there_may_not_be_skipped(tmp_path: Path) -> None:
    (tmp_path / "shared" / "data").mkdir(parents=True)
    assert session(tmp_path, "def test_it(): pytest.skip('needs ../shared/data')", strict=True).returncode == 1


def test_a_whole_module_is_no_way_around(tmp_path: Path) -> None:
    (tmp_path / "repository" / "tests").mkdir(parents=True)
    (tmp_path / "repository" / "tests" / "test_other.py").write_text("def test_other(): pass")
    assert session(tmp_path, "pytest.skip('no time', allow_module_level=True)").returncode == 1


def test_a_last_test_that_breaks_its_worker_fails_the_session(tmp_path: Path) -> None:
    """A numpy number in a report breaks a worker of pytest-xdist, which alone would say "1 passed" and exit 0."""
    body = "def test_first(): pass\n\n\ndef test_last(record_property):\n"
    body += "    __import__('time').sleep(1.0)\n    record_property('x', __import__('numpy').float64(1))"
    ended = session(tmp_path, body, "-p", "xdist", "-n", "2")
    assert (ended.returncode, "a worker was lost" in ended.stdout) == (1, True)


def test_every_name_in_the_sample_of_full_tests_is_a_test() -> None:
    """A renamed test would otherwise leave the gate without a word."""
    script = (ROOT / ".ci" / "run").read_text()
    names = set(
        re.findall(r"\btest_\w+", "".join(re.findall(r"^(?:FULL_SAMPLE|DOCKER_TEST).*$", script, re.MULTILINE)))
    )
    assert names
    files = [path for path in TESTS.rglob("test_*.py") if path != Path(__file__)]
    known = {path.stem for path in files} | {
        name for path in files for name in re.findall(r"^\s*(?:async )?def (test_\w+)", path.read_text(), re.MULTILINE)
    }
    assert {name for name in names if not any(name in one for one in known)} == set()


@pytest.mark.parametrize(
    ("marks", "expression", "left_out"),
    [
        ("pytest.mark.slow", "not slow and not full", True),
        ("pytest.mark.slow", "not full", False),
        ("pytest.mark.slow", "slow and not full", False),
        ("pytest.mark.slow", "", False),
        ("[pytest.mark.full, pytest.mark.costly_fixture]  # in `make test`: others", "not full", True),
        ("[\n    needs_it,\n    pytest.mark.slow,\n]", "not slow and not full", True),
        ('pytest.mark.usefixtures("in_process")', "not slow and not full", False),
        ("pytest.mark.slowly", "not slow", False),
    ],
)
def test_modules_that_would_be_deselected_are_not_imported(
    pytestconfig: pytest.Config, tmp_path: Path, marks: str, expression: str, left_out: bool
) -> None:
    (ours,) = [found for found in pytestconfig.pluginmanager.get_plugins() if hasattr(found, "MARKS_OF_MODULE")]
    module = tmp_path / "test_it.py"
    module.write_text(f"import pytest\n\npytestmark = {marks}\n\n\n@pytest.mark.slow\ndef test_it() -> None: ...\n")
    config = SimpleNamespace(option=SimpleNamespace(markexpr=expression))
    assert bool(ours.pytest_ignore_collect(module, config)) is left_out


@pytest.mark.parametrize(
    ("body", "expression", "left_out"),
    [
        ("def test_it() -> None: ...", "slow and not full", True),
        ("def test_it() -> None: ...", "not full", False),
        ("def test_it() -> None: ...", "full", False),  # `testing.sampling` gives that mark
        ("def test_it() -> None: ...", "slow or it", False),
        ("@pytest.mark.slow\ndef test_it() -> None: ...", "slow and not full", False),
    ],
)
def test_modules_without_slow_tests_are_not_imported_for_them(
    pytestconfig: pytest.Config, tmp_path: Path, body: str, expression: str, left_out: bool
) -> None:
    (ours,) = [found for found in pytestconfig.pluginmanager.get_plugins() if hasattr(found, "MARKS_OF_MODULE")]
    module = tmp_path / "test_it.py"
    module.write_text(f"import pytest\n\n\n{body}\n")
    config = SimpleNamespace(option=SimpleNamespace(markexpr=expression))
    assert bool(ours.pytest_ignore_collect(module, config)) is left_out


def test_no_helper_of_tests_marks_a_test_slow() -> None:
    """A module that says nothing of it would lose its slow tests."""
    assert [path.name for path in (TESTS / "testing").glob("*.py") if "mark.slow" in path.read_text()] == []
