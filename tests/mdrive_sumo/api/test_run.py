"""`evaluate` and the run that it returns."""

import subprocess
import sys
from pathlib import Path

import pytest
from testing.local_executor import run_in_process

import mdrive_sumo as md

pytestmark = [pytest.mark.slow, pytest.mark.costly_fixture]

SCENARIOS = "i0[12]*"


def make_agent() -> type:
    """Return a class that no worker process can import, as one of a notebook."""

    class StandingAgent:
        label = "single"

        def __init__(self, config: dict[str, float]) -> None:
            self.brake = config.get("brake", 1.0)

        def sensors(self) -> tuple[md.SensorSpec, ...]:
            return ()

        def start(self, briefing: md.Briefing) -> None:
            pass

        def act(self, seen: md.Observation) -> md.Reply:
            return md.Reply(control=md.Control(0.0, self.brake, 0.0))

    return StandingAgent


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> md.Run:
    suite = md.load_suite("interdrive@0")[SCENARIOS]
    assert isinstance(suite, md.Suite)
    out = tmp_path_factory.mktemp("run")
    with pytest.MonkeyPatch.context() as patch:
        run_in_process(patch)
        return md.evaluate(suite, agent="constant-speed", seeds=(3, 5), out=out, progress=False)


@pytest.fixture(scope="module")
def standing(tmp_path_factory: pytest.TempPathFactory) -> md.Run:
    out = tmp_path_factory.mktemp("standing")
    return md.evaluate("interdrive@0", make_agent(), scenario=SCENARIOS, workers=1, out=out, progress=False)


def test_a_run_of_several_seeds_has_one_folder_and_intervals(run: md.Run) -> None:
    assert len(run.folders) == 1 and run.seeds == (3, 5)
    assert len(run.scores) == 4 and all((folder / "report.md").is_file() for folder in run.folders)
    assert {one.seed for one in run.scores if one.id == run.scores[0].id} == {3, 5}
    whole = run.intervals[-1]
    assert whole.ds.mean == pytest.approx(run.scores.mean.ds) and (whole.ds.ends, whole.ds.units) == (None, 2)
    assert "seeds [3, 5], 4 episodes" in repr(run) and "suite interdrive" in str(run)
    assert md.load_run(run.folders) == run


def test_a_class_drives_in_worker_processes(standing: md.Run) -> None:
    frame = standing.scores.cavs_to_frame()
    assert set(frame.outcome) == {"blocked"} and frame.rc.max() < 5
    assert standing.results[0].run.agent.endswith("StandingAgent")


def test_scores_as_frames(run: md.Run) -> None:
    assert repr(run.scores).splitlines()[-1].startswith("mean ")
    frame = run.scores.to_frame()
    assert frame.ds.mean() == pytest.approx(run.scores.mean.ds)
    cavs = run.scores.cavs_to_frame()
    assert len(cavs.explode("infractions").dropna(subset="infractions")) == frame.infractions.sum() > 0
    assert isinstance(run.scores[:2], md.Scores) and run.scores[0].id == "i01_ins_c_main_street_right"


def test_the_worst_scenario_has_its_recording(run: md.Run) -> None:
    worst = run.worst(1)[0]
    assert worst.ds == min(result.ds for result in run.scores)
    episode = run.episode(worst)
    assert episode.digest == worst.digest and episode.seed == worst.seed
    assert run.episode(worst.id).seed == 3
    with pytest.raises(md.InputError, match="seed: expected one of 3, 5, found 4"):
        run.episode(worst.id, seed=4)


def test_runs_are_compared_by_mean_over_their_seeds(run: md.Run, standing: md.Run) -> None:
    comparison = md.compare(standing, run)
    frame = comparison.to_frame()
    expected = run.scores.to_frame().groupby("scenario").ds.mean()
    assert frame.set_index("scenario").ds_b.to_dict() == pytest.approx(expected.to_dict())
    assert comparison.ds.mean == pytest.approx(run.scores.mean.ds - standing.scores.mean.ds)
    assert "B is better in" in str(comparison)
    assert md.compare(str(standing.folders[0]), standing).ds.mean == 0


def test_a_run_is_verified_and_rescored(run: md.Run, monkeypatch: pytest.MonkeyPatch) -> None:
    run_in_process(monkeypatch)
    first = md.load_run(run.folders[0])
    verified = first.verify(sample=1, workers=1)
    assert [found.identical for found in verified] == [True] and " seed " in verified[0].scenario
    assert {results.run.score_mode for results in run.rescore("interdrive_fixed").results} == {"interdrive_fixed"}


def test_a_finished_run_is_not_driven_again(run: md.Run, capsys: pytest.CaptureFixture[str]) -> None:
    again = md.evaluate(
        "interdrive@0",
        "constant-speed",
        scenario="i01_ins_c_main_street_right,i02_ins_c_boulevard_straight",
        seeds=[3, 5],
        out=run.folders[0],
    )
    assert again.results[0].scenarios == run.results[0].scenarios
    assert "already complete" in capsys.readouterr().err


def test_a_changed_scenario_must_be_saved_first(tmp_path: Path) -> None:
    suite = md.load_suite("interdrive@0")
    changed = suite[0].model_copy(update={"weather": "dense-fog"})
    other = type(suite)(suite.about, suite.folder, (changed,))
    with pytest.raises(md.InputError, match=r"expected scenarios as they are in .*, found another 'i01"):
        md.evaluate(other, out=tmp_path)
    with pytest.raises(md.InputError, match="seeds: expected at least one"):
        md.evaluate(suite, seeds=[], out=tmp_path)
    with pytest.raises(md.InputError, match="seeds: expected each once, found 1, 1"):
        md.evaluate(suite, seeds=[1, 1], out=tmp_path)
    with pytest.raises(md.InputError, match=r"score_mode: expected one of .* did you mean 'interdrive_fixed'"):
        md.evaluate(suite, score_mode="interdrive_fix", out=tmp_path)


@pytest.mark.full
def test_a_script_without_a_main_guard_runs_once(tmp_path: Path) -> None:
    """Worker processes are spawned: Python would import the script in each of them."""
    script = tmp_path / "script.py"
    script.write_text(
        "import mdrive_sumo as md\n"
        "print('started')\n"
        "run = md.evaluate('interdrive@0', 'constant-speed', scenario='i02*', workers=1, out='run', progress=False)\n"
        "print(run.results[0].void)\n"
    )
    ended = subprocess.run([sys.executable, script], capture_output=True, text=True, cwd=tmp_path, check=True)
    assert ended.stdout == "started\n0\n"
