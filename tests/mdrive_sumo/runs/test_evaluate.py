"""`evaluate` with a stand-in for the simulation: order, resume, retries, voids, settings."""

from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from testing.journals import rewrite_journal
from testing.local_executor import LocalExecutor
from testing.paths import TESTS

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.evaluate import evaluate
from mdrive_sumo.runs.prepared_run import prepare
from mdrive_sumo.runs.run_config import RunConfig
from mdrive_sumo.scoring import Results, ScenarioResult, load_results

pytestmark = pytest.mark.slow


class Notes:
    """A Progress that remembers."""

    def __init__(self) -> None:
        self.kept: tuple[str, ...] = ()
        self.finished: list[str] = []
        self.notes: list[str] = []

    def begin(self, total: int, kept: dict[str, ScenarioResult]) -> None:
        self.kept = tuple(name for name, _ in kept)

    def done(self, result: ScenarioResult) -> None:
        self.finished.append(result.id)

    def show_running(self, running: dict[str, float]) -> None:
        """Nothing to remember."""

    def note(self, text: str) -> None:
        self.notes.append(text)


@pytest.fixture
def fakes(workers: ModuleType, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The same without worker processes."""
    monkeypatch.setattr("mdrive_sumo.runs.evaluate.make_executor", LocalExecutor)
    return workers


@pytest.fixture
def workers(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """`evaluate` drives in worker processes what `suite_fakes.drive` does there."""
    monkeypatch.syspath_prepend(str(TESTS))
    from testing import suite_fakes

    monkeypatch.setattr("mdrive_sumo.runs.evaluate.run_job", suite_fakes.drive)
    return suite_fakes


def run(tmp_path: Path, progress: Notes | None = None, **options: Any) -> Results:
    agent = AgentSpec(options.pop("agent", "stationary"), options.pop("agent_config", {}))
    config = RunConfig(str(tmp_path / "suite"), agent=agent, out=tmp_path / "run")
    return evaluate(prepare(replace(config, **options)), progress or Notes())


def calls(tmp_path: Path) -> list[str]:
    return (tmp_path / "run" / "calls").read_text().split()


def test_results_are_in_the_order_of_the_suite_and_on_disk(fakes: ModuleType, tmp_path: Path) -> None:
    fakes.make_suite(tmp_path / "suite", "nap", "answer", "answer")
    results = run(tmp_path)
    assert [(s.id, s.ds) for s in results.scenarios] == [("s0", 0.0), ("s1", 10.0), ("s2", 20.0)]
    assert results.overall.scenario_mean.ds == pytest.approx(10.0)
    assert load_results(tmp_path / "run" / "results.json") == results
    assert results.run.labels == ("single",)
    assert results.run.versions.keys() == {"python", "mdrive-sumo", "libsumo", "numpy"}


def test_two_workers_or_none_torn_or_not_the_same_bytes(
    workers: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    workers.make_suite(tmp_path / "suite", "nap", "answer", "answer")
    results = run(tmp_path, workers=2)
    assert [(s.id, s.ds) for s in results.scenarios] == [("s0", 0.0), ("s1", 10.0), ("s2", 20.0)]
    first = (tmp_path / "run" / "results.json").read_bytes()
    monkeypatch.setattr("mdrive_sumo.runs.evaluate.make_executor", LocalExecutor)
    run(tmp_path, workers=1, fresh=True)
    assert (tmp_path / "run" / "results.json").read_bytes() == first
    journal = tmp_path / "run" / "journal.jsonl"
    journal.write_bytes(journal.read_bytes()[:-200])
    run(tmp_path, workers=1)
    assert (tmp_path / "run" / "results.json").read_bytes() == first


def test_a_complete_run_is_not_run_again(fakes: ModuleType, tmp_path: Path) -> None:
    fakes.make_suite(tmp_path / "suite", "answer", "answer")
    first, again = run(tmp_path), Notes()
    assert run(tmp_path, again) == first
    assert (again.kept, again.finished) == (("s0", "s1"), [])
    assert calls(tmp_path) == ["s0", "s1"]
    run(tmp_path, again, fresh=True)
    assert again.finished == ["s0", "s1"]


def test_a_lost_recording_is_made_again(fakes: ModuleType, tmp_path: Path) -> None:
    fakes.make_suite(tmp_path / "suite", "answer", "answer")
    run(tmp_path)
    (tmp_path / "run" / "episodes" / "s1.npz").unlink()
    again = Notes()
    run(tmp_path, again)
    assert again.finished == ["s1"]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ((b'"rc":10.0', b'"rc":11.0'), r"journal.jsonl: line 3: expected the checksum \w+, found \w+: this line"),
        ((b'"seed":0', b'"seed":8'), r"journal.jsonl: line 1: expected the checksum"),
    ],
)
def test_a_digit_changed_in_the_journal_is_not_continued(
    fakes: ModuleType, tmp_path: Path, change: tuple[bytes, bytes], says: str
) -> None:
    fakes.make_suite(tmp_path / "suite", "answer", "answer")
    run(tmp_path)
    path = tmp_path / "run" / "journal.jsonl"
    path.write_bytes(path.read_bytes().replace(*change, 1))
    before = path.read_bytes()
    with pytest.raises(InputError, match=says):
        run(tmp_path)
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (('"ds":10.0', '"ds":1e6'), r"journal.jsonl: scenarios\[s1\].ds: expected 0 to 100, found 1000000.0; --fresh"),
        (('"ds":10.0', '"ds":99.5'), r"journal.jsonl: scenarios\[s1\].egos\[0\].ds: expected RC x IP, 10.0"),
        (('"id":"s1"', '"id":"s7"'), r"journal.jsonl: expected scenarios of this run, found 's7'; --fresh"),
        (('"seed":0,"status"', '"seed":3,"status"'), r"seed: expected the run's 0, found 3"),
    ],
)
def test_impossible_results_with_forged_checksums_are_not_continued(
    fakes: ModuleType, tmp_path: Path, change: tuple[str, str], says: str
) -> None:
    fakes.make_suite(tmp_path / "suite", "answer", "answer")
    run(tmp_path)
    rewrite_journal(tmp_path / "run" / "journal.jsonl", lambda line: line.replace(*change))
    with pytest.raises(InputError, match=says):
        run(tmp_path)


def test_a_truncated_recording_is_not_continued(fakes: ModuleType, tmp_path: Path) -> None:
    fakes.make_suite(tmp_path / "suite", "answer", "answer")
    first = run(tmp_path)
    path = tmp_path / "run" / "episodes" / "s1.npz"
    path.write_bytes(path.read_bytes()[:-3])
    with pytest.raises(InputError, match=r"s1.npz: expected the recording that journal.jsonl notes.* 5 bytes.*delete"):
        run(tmp_path)
    path.unlink()  # as the sentence says
    again = Notes()
    assert run(tmp_path, again) == first
    assert again.finished == ["s1"]


def test_a_killed_worker_costs_one_try(workers: ModuleType, tmp_path: Path) -> None:
    workers.make_suite(tmp_path / "suite", "kill first time", "answer")
    progress = Notes()
    results = run(tmp_path, progress)
    assert (results.void, [s.id for s in results.scenarios]) == (0, ["s0", "s1"])
    assert calls(tmp_path) == ["s0", "s1", "s0"]
    assert progress.notes == ["s0: the worker process was ended by SIGKILL; tried again later"]


def test_two_crashes_of_a_worker_make_a_void(workers: ModuleType, tmp_path: Path) -> None:
    workers.make_suite(tmp_path / "suite", "segfault")
    assert run(tmp_path).scenarios[0].reason == "the worker process was ended by SIGSEGV"


@pytest.mark.parametrize(
    ("deed", "reason"), [("world", "SUMO lost the road"), ("raise", "ZeroDivisionError in pool_fakes.py")]
)
def test_two_failed_tries_make_a_void_that_counts_as_zero(
    fakes: ModuleType, tmp_path: Path, deed: str, reason: str
) -> None:
    fakes.make_suite(tmp_path / "suite", "answer", deed, "answer")
    results = run(tmp_path)
    assert [s.status for s in results.scenarios] == ["ok", "void", "ok"]
    assert results.scenarios[1].reason.startswith(reason)
    assert results.void == 1
    assert results.overall.scenario_mean.ds == pytest.approx(20.0 / 3)
    assert calls(tmp_path).count("s1") == 2


def test_the_same_command_tries_voids_again(fakes: ModuleType, tmp_path: Path) -> None:
    fakes.make_suite(tmp_path / "suite", "answer", "raise")
    run(tmp_path)
    again = Notes()
    run(tmp_path, again)
    assert (again.kept, again.finished) == (("s0",), ["s1"])


def test_a_hung_episode_becomes_void(workers: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mdrive_sumo.runs.prepared_run.SIMULATION_LIMIT_S", 1.0)
    workers.make_suite(tmp_path / "suite", "hang")
    assert run(tmp_path).scenarios[0].reason == "hung: no result within 1 s"


def test_bad_input_found_by_a_worker_ends_the_run(fakes: ModuleType, tmp_path: Path) -> None:
    fakes.make_suite(tmp_path / "suite", "answer", "input", "answer")
    with pytest.raises(InputError, match="expected a road, found the sea"):
        run(tmp_path)
    assert not (tmp_path / "run" / "results.json").exists()


def test_another_command_does_not_continue_the_run(fakes: ModuleType, tmp_path: Path) -> None:
    suite = fakes.make_suite(tmp_path / "suite", "answer")
    run(tmp_path)
    with pytest.raises(InputError, match=r"another seed 0 \(now 1\)"):
        run(tmp_path, seeds=(1,))
    fakes.make_suite(suite.folder, "nap")
    with pytest.raises(InputError, match="another suite_checksum"):
        run(tmp_path)


def test_old_results_do_not_outlive_a_fresh_start(fakes: ModuleType, tmp_path: Path) -> None:
    suite = fakes.make_suite(tmp_path / "suite", "answer")
    run(tmp_path)
    fakes.make_suite(suite.folder, "input")
    with pytest.raises(InputError):
        run(tmp_path, fresh=True)
    assert not (tmp_path / "run" / "results.json").exists()


def test_a_glob_chooses_scenarios(fakes: ModuleType, tmp_path: Path) -> None:
    fakes.make_suite(tmp_path / "suite", "answer", "answer", "answer")
    assert [s.id for s in run(tmp_path, scenario="s[02]").scenarios] == ["s0", "s2"]


AGENT = """
class Driver:
    label = "sharing"
    def __init__(self, config):
        assert config == {"speed": 3}
    def sensors(self):
        from mdrive_sumo.contract import SensorSpec
        return (SensorSpec("privileged"),)
    def start(self, briefing): ...
    def act(self, seen): ...
"""


def test_an_agent_from_a_file_is_labelled_and_part_of_the_fingerprint(fakes: ModuleType, tmp_path: Path) -> None:
    fakes.make_suite(tmp_path / "suite", "answer")
    (tmp_path / "mine.py").write_text(AGENT)
    options = {"agent": f"{tmp_path}/mine.py:Driver", "agent_config": {"speed": 3}}
    info = run(tmp_path, **options).run
    assert (info.labels, info.declared_label) == (("privileged", "unsandboxed"), "sharing")
    (tmp_path / "mine.py").write_text(AGENT + "# changed\n")
    with pytest.raises(InputError, match="another agent_code"):
        run(tmp_path, **options)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"agent": "nobody"}, "agent 'nobody': expected .*stationary.*found neither"),
        ({"agent": "perception-swap:nobody"}, "agent 'perception-swap:nobody': expected .*perception-swap:cobevt"),
        ({"agent": "no_such_module:Agent"}, "no_such_module"),
        ({"agent": "missing.py:Agent"}, "missing.py: expected a Python file, found none"),
        ({"agent": "stationary", "agent_config": {"no": 1}}, "no"),
        ({"scenario": "nothing*"}, "expected a scenario id or category like 'nothing\\*', found none"),
        ({"suite": "nowhere"}, "suite 'nowhere': expected a folder or one of"),
    ],
)
def test_bad_settings_are_one_sentence(
    fakes: ModuleType, tmp_path: Path, options: dict[str, object], sentence: str
) -> None:
    fakes.make_suite(tmp_path / "suite", "answer")
    with pytest.raises(InputError, match=sentence) as caught:
        run(tmp_path, **options)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "run").exists()


def test_a_missing_network_is_found_before_any_work(fakes: ModuleType, tmp_path: Path) -> None:
    suite = fakes.make_suite(tmp_path / "suite", "answer")
    (suite.folder / "networks" / "flat" / "map.net.xml.gz").unlink()
    with pytest.raises(InputError, match="cannot be read as a gzipped SUMO network"):
        run(tmp_path)
