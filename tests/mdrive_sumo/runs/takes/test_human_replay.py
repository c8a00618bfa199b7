"""`human-replay`: the recorded drive of a person as an agent."""

import json
from pathlib import Path

import pytest
from click.testing import Result
from testing.takes import invoke, load_recorded

import mdrive_sumo as md
from mdrive_sumo.scoring import load_results

pytestmark = pytest.mark.usefixtures("in_process")


def write_options(folder: Path, **options: object) -> Path:
    path = folder / "options.json"
    path.write_text(json.dumps(options))
    return path


def replay(folder: Path, *words: str | Path | int, **options: object) -> Result:
    """Evaluate `human-replay` with options into FOLDER/run."""
    path = write_options(folder, **options)
    more = ("--agent", "human-replay", "--agent-config", path, "--workers", 1, "--out", folder / "run")
    return invoke("eval", *words, *more)


@pytest.mark.slow
def test_a_replay_is_the_take_under_its_own_name(tmp_path: Path, suite: Path, take: Path) -> None:
    run, ended = tmp_path / "run", replay(tmp_path, "--suite", suite, take=str(take))
    assert ended.exit_code == 0, ended.output
    assert load_recorded(run).digest == load_recorded(take).digest
    assert load_results(run / "results.json").run.agent == "human-replay"
    ended = invoke("verify", run, "--workers", 1)
    assert ended.exit_code == 0, ended.output
    assert "people" not in ended.stdout  # it is the take that says what people did
    assert str(tmp_path) not in (run / "journal.jsonl").read_text()


@pytest.mark.slow
def test_a_replay_finds_its_take_from_anywhere(
    tmp_path: Path, suite: Path, take: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(take.parent)
    assert replay(tmp_path, "--suite", suite, take=take.name).exit_code == 0
    monkeypatch.chdir("/")
    ended = invoke("verify", tmp_path / "run", "--workers", 1)
    assert ended.exit_code == 0, ended.output


@pytest.mark.slow
def test_a_replay_identifies_its_take(tmp_path: Path, suite: Path, take: Path) -> None:
    run = tmp_path / "run"
    assert replay(tmp_path, "--suite", suite, take=str(take)).exit_code == 0
    (recording,) = (take / "episodes").iterdir()
    recording.write_bytes((run / "episodes" / recording.name).read_bytes())  # another file of the same episode
    ended = invoke("verify", run, "--workers", 1)
    assert "file that an option of the agent names" in ended.stderr
    recording.unlink()
    ended = invoke("verify", run, "--workers", 1)
    assert (ended.exit_code, "expected a take of i01_" in ended.stderr) == (2, True), ended.output


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 3])  # another CAV is under test
def test_a_replay_among_other_agents(tmp_path: Path, suite: Path, take: Path, seed: int) -> None:
    """The world is another one: the controls of the take are repeated as long as there are any."""
    run = tmp_path / "run"
    ended = replay(tmp_path, "--suite", suite, "--others", "stationary", "--seed", seed, take=str(take))
    assert ended.exit_code in (0, 1), ended.output
    tested = [not ego.is_other for ego in load_results(run / "results.json").scenarios[0].egos].index(True)
    again, before = (load_recorded(folder).controls[:30, tested] for folder in (run, take))
    assert tested or (again == before).all()
    assert invoke("verify", run, "--workers", 1).exit_code == 0


def test_a_replay_in_python(suite: Path, take: Path) -> None:
    options = {"take": str(take)}
    episode = md.simulate(load_recorded(take).scenario, "human-replay", agent_config=options, suite=str(suite))
    assert episode.record.digest == load_recorded(take).digest


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({}, "option take: expected the run folder of a take, e.g."),
        ({"take": 3}, "option take: expected the run folder of a take, e.g."),
        ({"take": "nowhere"}, "option take: expected the run folder of a take, found no nowhere/journal.jsonl"),
        ({"take": "{other}"}, "option take: expected a take, found"),
        ({"take": "{take}", "substitutes": ""}, "expected a driver among human (option substitutes), found 'sharing'"),
    ],
)
def test_a_replay_without_a_take(
    tmp_path: Path, suite: Path, take: Path, options: dict[str, object], says: str
) -> None:
    other = tmp_path / "other"
    assert invoke("eval", "--suite", suite, "--agent", "stationary", "--workers", 1, "--out", other).exit_code == 0
    places = {"{other}": str(other), "{take}": str(take)}
    ended = replay(tmp_path, "--suite", suite, **{key: places.get(str(one), one) for key, one in options.items()})
    assert (ended.exit_code, ended.stderr.count("\n")) == (2, 1), ended.output
    assert says in ended.stderr


def test_a_take_of_another_scenario(tmp_path: Path, take: Path) -> None:
    ended = replay(tmp_path, "--suite", "interdrive@0", "--scenario", "i02_*", take=str(take))
    assert (ended.exit_code, ended.stderr.count("\n")) == (2, 1), ended.output
    assert "expected a take of i02_" in ended.stderr
    assert "found i01_" in ended.stderr


def test_open_loop_wants_plans(tmp_path: Path, take: Path) -> None:
    path = write_options(tmp_path, take=str(take))
    ended = invoke("eval-open", "--reference", take, "--agent", "human-replay", "--agent-config", path)
    assert (ended.exit_code, "a take is a reference: --reference RUN" in ended.stderr) == (2, True), ended.output
