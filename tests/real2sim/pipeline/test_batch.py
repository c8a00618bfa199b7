"""Many logs become one suite: what cannot be converted costs a sentence, and nothing stays of a suite that failed."""

import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace

import pytest
from testing.local_executor import LocalExecutor

from mdrive_sumo.core.errors import InputError
from real2sim.pipeline import batch, conversion_worker
from real2sim.pipeline.batch import BatchOptions, BatchResult, NoLogConvertedError, convert_logs
from real2sim.pipeline.conversion_options import ConversionOptions
from real2sim.pipeline.log_source import LogSource


def convert_by_name(log: LogSource, draft: Path, _wish: ConversionOptions) -> SimpleNamespace:
    """Convert without a reader: the log `bad.x` is refused, `crash.x` fails, `ID.x` becomes ID and misses a target."""
    id_ = log.path.stem + (f"_{log.window[0]:g}" if log.window else "")
    (draft / id_).mkdir(parents=True)
    (draft / id_ / "scenario.json").write_text("{}")
    (draft / "networks" / id_).mkdir(parents=True)
    if id_ == "bad":
        raise InputError(f"{log.path}: expected tracks, found none")
    if id_ == "crash":
        raise RuntimeError("of the converter")
    if id_ == "full":
        raise OSError(28, "No space left on device")
    misses = ("error p95: 2 m, at most 1 m wanted",) if id_ == "poor" else ()
    return SimpleNamespace(scenario=SimpleNamespace(id=id_), findings=SimpleNamespace(misses=misses))


@pytest.fixture(autouse=True)
def without_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batch, "ProcessPool", LocalExecutor)
    monkeypatch.setattr(conversion_worker, "convert_log", convert_by_name)
    monkeypatch.setattr(conversion_worker, "_redirect_stdout", lambda: None)


def convert(
    out: Path, names: Sequence[str], said: list[str] | None = None, every_s: float | None = None
) -> BatchResult:
    def tell(done: int, total: int, text: str) -> None:
        if said is not None:
            said.append(f"{done}/{total} {text}")

    logs = [LogSource("test", Path("/logs") / name) for name in names]
    return convert_logs(logs, out, "suite", BatchOptions(progress=tell, every_s=every_s))


def test_a_suite_has_the_logs_that_can_be_converted_in_their_order(tmp_path: Path) -> None:
    said: list[str] = []
    done = convert(tmp_path / "out", ("b.x", "bad.x", "a.x", "poor.x", "crash.x"), said)
    assert [one.id for one in done.outcomes] == ["b", "a", "poor"]
    assert [one.id for one in done.below_target] == ["poor"]
    refused, failed = done.refused
    assert refused == "/logs/bad.x: expected tracks, found none"
    assert re.fullmatch(r"/logs/crash\.x: conversion failed: RuntimeError in .*: of the converter", failed)
    assert said == [
        "1/5 b.x: passed", "2/5 bad.x: unusable", "3/5 a.x: passed", "4/5 poor.x: misses 1 target",
        "5/5 crash.x: unusable",
    ]  # fmt: skip
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"a", "b", "poor", "networks", "suite.json"}
    assert {path.name for path in (tmp_path / "out" / "networks").iterdir()} == {"a", "b", "poor"}


def test_a_log_given_twice_and_two_logs_of_one_name_are_told_apart(tmp_path: Path) -> None:
    said: list[str] = []
    done = convert(tmp_path / "out", ("a.x", "sub/../a.x", "other/a.x"), said)
    assert [one.id for one in done.outcomes] == ["a"]
    assert done.refused == (
        "/logs/sub/../a.x: expected every log once, found it twice",
        "/logs/other/a.x: expected logs of different names, found a twice",
    )
    assert said == ["1/2 a.x: passed", "2/2 a.x: unusable, the second a"]


@pytest.mark.parametrize(
    ("names", "why"),
    [(("bad.x", "bad.x"), "expected every log once.*; .*expected tracks"), ((), "expected at least one log")],
)
def test_a_suite_of_nothing_is_not_written(names: tuple[str, ...], why: str, tmp_path: Path) -> None:
    with pytest.raises(NoLogConvertedError, match=why) as caught:
        convert(tmp_path / "out", names)
    assert len(caught.value.refused) == len(names)
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_concerns_all_logs_and_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No space left on device"):
        convert(tmp_path / "out", ("a.x", "full.x"))
    assert list(tmp_path.iterdir()) == []


def test_every_window_of_a_log_becomes_a_scenario(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def split(log: LogSource, every_s: float) -> tuple[tuple[float, float], ...]:
        if log.path.stem == "bad":
            raise InputError(f"{log.path}: expected tracks, found none")
        return ((0.0, every_s), (every_s, 2 * every_s))

    monkeypatch.setattr(conversion_worker, "split_into_windows", split)
    said: list[str] = []
    done = convert(tmp_path / "out", ("a.x", "bad.x"), said, every_s=5.0)
    assert [one.id for one in done.outcomes] == ["a_0", "a_5"]
    assert done.refused == ("/logs/bad.x: expected tracks, found none",)
    assert said == ["1/2 a.x, window 0 s to 5 s: passed", "2/2 a.x, window 5 s to 10 s: passed"]


@pytest.mark.slow
def test_only_workers_import_what_converts() -> None:
    code = (
        "import sys, real2sim.cli, real2sim.pipeline.batch\n"
        "heavy = {'numpy', 'pydantic', 'libsumo', 'shapely', 'jinja2', 'real2sim.pipeline.conversion_worker'}\n"
        "sys.exit(f'imported {heavy & set(sys.modules)}' if heavy & set(sys.modules) else 0)\n"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (ended.returncode, ended.stderr) == (0, "")
