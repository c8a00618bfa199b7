"""The comparison of a tick's processor time with a stored commit: what it calls slower, and what it cannot tell."""

import importlib.util
import subprocess
import sys
from collections.abc import Generator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from testing.paths import ROOT

EPISODES = 4


@pytest.fixture(scope="module")
def speed() -> Generator[ModuleType]:
    spec = importlib.util.spec_from_file_location("speed", ROOT / "tests" / "bench" / "speed.py")
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules["speed"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    yield module
    del sys.modules["speed"]


def rounds(speed: ModuleType, *cpu: tuple[float, float]) -> list[Any]:
    """Rounds with these seconds of the new and the old commit for 100 ticks of each episode."""
    return [[tuple(speed.Sample(100, side, None, "x") for side in pair)] * EPISODES for pair in cpu]


def test_a_slower_tick_fails_when_it_has_shown_often_enough(
    speed: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    slower = rounds(speed, *[(1.2, 1.0)] * 8)
    assert not speed.is_clear(slower[:7], 1.1)
    assert speed.is_clear(slower, 1.1)
    assert speed.report(slower, "0123456789", 1.1) == 1
    assert "together x 1.200" in capsys.readouterr().out
    assert speed.report(slower, "0123456789", None) == 0  # the table of `make bench`


def test_a_tick_that_is_as_fast_passes_at_once(speed: ModuleType) -> None:
    as_fast = rounds(speed, *[(1.04, 1.0)] * speed.MIN_ROUNDS)
    assert speed.is_clear(as_fast, 1.1)
    assert not speed.is_clear(as_fast[1:], 1.1)
    assert speed.report(as_fast, "0123456789", 1.1) == 0


def test_a_busy_machine_alone_fails_nothing(speed: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    """Half of the new runs are disturbed, or one run of the old commit is fast by chance."""
    disturbed = rounds(speed, *[(1.5, 1.0)] * 5, *[(1.0, 1.0)] * 3)
    assert not speed.is_clear(disturbed, 1.1)
    assert speed.report(disturbed, "0123456789", 1.1) == 0
    assert "too busy to tell" in capsys.readouterr().out
    lucky = rounds(speed, (1.0, 0.8), *[(1.0, 1.0)] * 7)
    assert not speed.is_clear(lucky, 1.1)
    assert speed.report(lucky, "0123456789", 1.1) == 0


def test_a_clone_without_the_commit_says_so(
    speed: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["speed.py", "--most", "1.1", "--commit", "0" * 40])
    assert speed.main() == 0
    assert capsys.readouterr().out == (
        "speed is not compared with 00000000: this clone does not have that commit; `git fetch --unshallow` brings it\n"
    )


def test_the_stored_commit_is_a_full_hash() -> None:
    commit, *reason = (ROOT / "tests" / "bench" / "speed_commit").read_text().split(maxsplit=1)
    assert len(commit) == 40
    assert int(commit, 16)
    assert reason


def test_an_old_commit_is_unpacked_and_built(
    speed: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clone, folders = tmp_path / "clone", [tmp_path / name for name in ("sound", "damaged", "unloaded")]

    def commit(builder: str) -> str:
        (clone / "hatch_build.py").write_text(builder)
        author = ("-c", "user.name=a", "-c", "user.email=a@example.org")
        for command in (("add", "-A"), (*author, "commit", "-qm", "x")):
            subprocess.run(["git", "-C", str(clone), *command], check=True)
        return subprocess.check_output(["git", "-C", str(clone), "rev-parse", "HEAD"], text=True).strip()

    for part in ("networks", "real2sim", "mdrive_sumo", "mdrive_sumo/core", "mdrive_sumo/core/compiled"):
        (clone / part).mkdir(parents=True)
        (clone / part / "__init__.py").write_text("'old'")
    twins = clone / "mdrive_sumo" / "core" / "compiled" / "twins.py"
    twins.write_text("PROBLEM = ''")
    subprocess.run(["git", "init", "-q", str(clone)], check=True)
    monkeypatch.setattr(speed, "ROOT", clone)
    sound, damaged = commit("open('built', 'w')"), commit("raise OSError('no compiler')")
    twins.write_text("PROBLEM = 'undefined symbol'")
    unloaded = commit("open('built', 'w')")
    (clone / "mdrive_sumo" / "__init__.py").write_text("'new'")
    assert speed.unpack(sound, folders[0]) == ""
    assert (folders[0] / "mdrive_sumo" / "__init__.py").read_text() == "'old'"
    assert (folders[0] / "built").is_file()
    assert speed.unpack(damaged, folders[1]) == "OSError: no compiler"
    with pytest.raises(SystemExit, match=f"expected the compiled layer of {unloaded[:8]}, found undefined symbol"):
        speed.unpack(unloaded, folders[2])


def test_instructions_are_counted_where_the_machine_counts_them(speed: ModuleType) -> None:
    counter = speed.open_instruction_counter()
    before, after = speed.read_instructions(counter), speed.read_instructions(counter)
    assert before is after is None or before < after
