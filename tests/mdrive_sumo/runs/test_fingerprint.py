"""What makes two runs the same: the code, the versions, and the files that options name, such as weights."""

import os
from pathlib import Path

import pytest
from testing.tiny_network import save_tiny_weights

from mdrive_sumo.agents.learned.system_spec import SYSTEMS
from mdrive_sumo.runs import fingerprint as module
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.compare import select_shared_versions
from mdrive_sumo.runs.fingerprint import (
    SOURCES,
    WITHOUT_SOURCES,
    compute_code_checksum,
    compute_fingerprint,
    read_versions,
)
from mdrive_sumo.runs.journal import JournalText
from mdrive_sumo.runs.prepared_run import prepare
from mdrive_sumo.runs.run_config import RunConfig
from mdrive_sumo.runs.stored_run import StoredRun
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.scoring import RunInfo, ScenarioResult, summarize_run


def test_other_weights_at_the_same_path_are_another_run(tmp_path: Path) -> None:
    weights = tmp_path / "tcp.onnx"
    weights.write_bytes(b"one")
    suite = load_suite("interdrive@0")
    config = RunConfig(agent=AgentSpec("tcp", {"weights": str(weights), "creep": 0}))
    first, options = compute_fingerprint(config, suite, suite.scenarios[:1]), config.agent.config_hash()
    assert compute_fingerprint(config, suite, suite.scenarios[:1]) == first
    weights.write_bytes(b"two")
    second = compute_fingerprint(config, suite, suite.scenarios[:1])
    assert {name for name in second if second[name] != first[name]} == {"agent_files"}
    assert config.agent.config_hash() != options, "results tell them apart, too"


def test_verify_says_that_weights_have_changed(tmp_path: Path) -> None:
    weights = save_tiny_weights(tmp_path, SYSTEMS["tcp"])
    config = RunConfig(
        suite="interdrive@0", scenario="i01*", agent=AgentSpec("tcp", {"weights": str(weights)}), out=tmp_path / "run"
    )
    run = prepare(config)
    result = ScenarioResult.model_validate(
        {
            "id": "i01", "bucket": "InterDrive", "category": "c", "seed": 0, "status": "ok", "reason": "", "ds": 0.0,
            "sr": 0.0, "rc": 0.0, "ip": 1.0, "min_ttc": None, "digest": "", "ticks": 1, "egos": (),
        }
    )  # fmt: skip
    stored = StoredRun(run, summarize_run(run.info, [result]), JournalText((), "", 0, False))
    assert stored.describe_version_changes() == ""
    weights.write_bytes(b"others")
    assert stored.describe_version_changes() == "file that an option of the agent names"


def test_options_without_files_are_no_files(tmp_path: Path) -> None:
    for value in ("", "gpt", str(tmp_path), "x" * 5000, "nul\0", 1):
        assert AgentSpec("tcp", {"weights": value}).files_checksum() == ""
    assert AgentSpec("single").config_hash() == ""


def test_packaged_weights_are_part_of_the_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = compute_code_checksum()
    assert compute_code_checksum() == before
    monkeypatch.setattr(module, "WEIGHTS_FOLDER", tmp_path)
    assert compute_code_checksum() != before


@pytest.mark.parametrize("name", ["a.py", "a.c"])
def test_a_change_of_the_code_is_seen_while_the_process_lives(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A notebook evaluates, a file is edited, the notebook evaluates again: its workers have the new code."""
    monkeypatch.setattr(module, "PACKAGE", tmp_path)
    monkeypatch.setattr(module, "WEIGHTS_FOLDER", tmp_path)
    file = tmp_path / "room" / name
    file.parent.mkdir()
    checksums: list[str] = []
    for text in ("x = 1", "x = 2", "x = 1"):
        file.write_text(text)
        os.utime(file, (1, 1))  # a copy may keep the times
        checksums.append(compute_code_checksum())
    assert checksums[0] == checksums[2] != checksums[1]
    (tmp_path / "b.py").touch()
    assert compute_code_checksum() not in checksums


def test_onnx_runtime_counts_where_it_computes() -> None:
    assert "onnxruntime" not in read_versions((AgentSpec("single"), AgentSpec("path.py:Class")))
    assert read_versions((AgentSpec("single"), AgentSpec("vad")))["onnxruntime"].count(".") == 2


def test_a_learned_and_another_agent_have_the_same_versions() -> None:
    rule = RunInfo(
        agent="single",
        suite="x",
        suite_checksum="",
        seed=0,
        score_mode="mdrive",
        versions={"python": "3", "numpy": "2"},
    )
    learned = rule.model_copy(update={"versions": {**rule.versions, "onnxruntime": "1"}})
    here, there = select_shared_versions(rule, learned)
    assert here == there == rule.versions
    here, there = select_shared_versions(learned, learned.model_copy(update={"versions": {"onnxruntime": "2"}}))
    assert here != there


def test_folders_that_are_not_searched_hold_no_sources() -> None:
    for folder in map(Path, WITHOUT_SOURCES):
        assert folder.is_dir()
        assert [path.name for kind in SOURCES for path in folder.rglob(f"*{kind}")] == []
