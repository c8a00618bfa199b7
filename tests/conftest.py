"""Shared by all tests: hypothesis profiles, material that may be absent, which skips are accepted."""

import gc
import os
import re
import signal
from collections.abc import Generator
from functools import lru_cache
from importlib import import_module
from pathlib import Path

import pytest
from hypothesis import Phase, settings
from testing.shared_material import NEEDS_SHARED_DATA, SHARED_DATA

MACHINE = ("needs control groups", "needs root", "needs x86-64")
"""What a machine has or has not; nothing can be installed for it."""
INSTALLED = (
    "needs bubblewrap",
    "needs buildah",
    "needs Chromium",
    "needs dash",
    "needs gVisor's runsc",
    "needs netconvert",
    "needs OpenGL",
    "needs tshark",
)
SKIP_REASONS = (NEEDS_SHARED_DATA, *MACHINE, *INSTALLED, "needs PostgreSQL")
"""Why a test may skip. The gate (MDRIVE_STRICT_SKIPS) installs what it can: there only machine and data count."""

settings.register_profile("laptop", deadline=None, max_examples=30)
settings.register_profile("ci", deadline=None, max_examples=30, derandomize=True)
settings.register_profile("check", deadline=None, max_examples=20)
# The same examples for every mutant; what fails is not made smaller.
settings.register_profile(
    "mutants", deadline=None, max_examples=30, derandomize=True, phases=(Phase.explicit, Phase.generate)
)
settings.register_profile("all", deadline=None)  # `testing.sampling`: properties get all their examples
settings.load_profile(os.environ.get("TESTS_PROFILE") or ("ci" if os.environ.get("CI") else "laptop"))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The read-only material beside the repository."""
    if not SHARED_DATA.is_dir():
        pytest.skip(NEEDS_SHARED_DATA)
    return SHARED_DATA


@pytest.fixture(scope="session", autouse=True)
def read_scenarios_once() -> Generator[None]:
    """Keep what scenario files of this state hold: hundreds of tests load the packaged suites. Scenarios are frozen."""
    suite = import_module("mdrive_sumo.scenario.suite")
    load_scenario = suite.load_scenario

    @lru_cache(maxsize=1024)
    def load_state(path: Path, *_: int) -> object:
        return load_scenario(path)

    def load_once(path: Path) -> object:
        try:
            status = path.stat()
        except OSError:
            return load_scenario(path)
        return load_state(path, status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(suite, "load_scenario", load_once)
        yield


@pytest.fixture
def intervals_of_few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let any number of scenarios give an interval: for tests of its arithmetic on values made by hand."""
    monkeypatch.setattr("mdrive_sumo.core.statistics.MIN_UNITS", 1)
    monkeypatch.setattr("mdrive_sumo.core.statistics.MIN_EFFECTIVE", 1.0)
    monkeypatch.setattr("mdrive_sumo.core.statistics.compute_expanded_tail", lambda clusters: 0.025)
    monkeypatch.setattr("mdrive_sumo.core.statistics.compute_expanded_p_value", lambda tail, clusters: 2 * tail)


def accepted_reasons() -> tuple[str, ...]:
    """Reasons that do not fail this session."""
    if not os.environ.get("MDRIVE_STRICT_SKIPS"):
        return SKIP_REASONS
    return MACHINE if SHARED_DATA.is_dir() else (NEEDS_SHARED_DATA, *MACHINE)


class Guard:
    """Fails the session for what pytest would let pass: skips without an accepted reason, and lost workers.

    When the last test of a session breaks its worker of pytest-xdist, it is dropped and the session counts as passed.
    """

    def __init__(self) -> None:
        self.problems: list[str] = []

    def pytest_internalerror(self) -> None:
        self.problems.append("INTERNAL ERROR: a worker was lost, and with it the tests it had not reported")

    def _look_at(self, report: pytest.TestReport | pytest.CollectReport) -> None:
        if not report.skipped or hasattr(report, "wasxfail"):
            return
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        if reason.removeprefix("Skipped: ") not in accepted_reasons():
            self.problems.append(f"SKIPPED WITHOUT AN ACCEPTED REASON: {report.nodeid}: {reason}")

    pytest_runtest_logreport = _look_at
    pytest_collectreport = _look_at

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if self.problems and session.exitstatus == pytest.ExitCode.OK:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        for problem in self.problems:
            terminalreporter.write_line(problem, red=True)


MARKS_OF_MODULE = re.compile(r"^pytestmark = (\[\n(?:    .*\n)*\]|.*$)", re.MULTILINE)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out modules whose tests would all be deselected: each worker imports and collects the rest."""
    if collection_path.suffix != ".py" or not collection_path.name.startswith("test_"):
        return None
    text = collection_path.read_text("utf-8")
    parts = config.option.markexpr.split(" and ")
    if "slow" in parts and "pytest.mark.slow" not in text:  # `full` is also given by `testing.sampling`
        return True
    marks = "".join(MARKS_OF_MODULE.findall(text))
    unwanted = [part.removeprefix("not ") for part in parts if part.startswith("not ")]
    return True if any(re.search(rf"\bpytest\.mark\.{mark}\b", marks) for mark in unwanted) else None


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Collect without the garbage collector, and let it never look at modules and tests again: they stay."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.collect()
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Run modules with a costly fixture first, then tests that have a limit of time of their own.

    The last tests are dealt to the workers of pytest-xdist one by one, and each worker would make the fixture again; a
    test of minutes among the last ones would run while the other workers have nothing to do.
    """
    items.sort(key=lambda item: [item.get_closest_marker(name) is None for name in ("costly_fixture", "timeout")])


def pytest_configure(config: pytest.Config) -> None:
    # A shell ignores SIGINT for what it runs in the background, children inherit that, and then Ctrl-C tests hang.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    # Workers of pytest-xdist send their reports to the process that has no workerinput.
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(Guard(), "guard")
