"""`simulate` and the episode that it returns."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from testing.short_suite import make_short_suite

import mdrive_sumo as md
from mdrive_sumo.core.state import End
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_job import EpisodeJob, run_job
from mdrive_sumo.scoring import ScoreMode

pytestmark = [pytest.mark.slow, pytest.mark.costly_fixture]

SCENARIO = "i12_ins_sl_old_town"
mpl.use("Agg")


class BrokenAgent:
    """An agent that fails in tick 3."""

    label = "single"

    def __init__(self, config: object) -> None:
        pass

    def sensors(self) -> tuple[md.SensorSpec, ...]:
        return ()

    def start(self, briefing: md.Briefing) -> None:
        pass

    def act(self, seen: md.Observation) -> md.Reply:
        if seen.tick == 3:
            raise ZeroDivisionError("tick 3")
        return md.Reply(control=md.Control(0.0, 1.0, 0.0))


@pytest.fixture(scope="module")
def suite(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(make_short_suite(tmp_path_factory.mktemp("short") / "suite", SCENARIO, metres=20))


@pytest.fixture(scope="module")
def episode(suite: str) -> md.Episode:
    return md.simulate(SCENARIO, suite=suite, agent="sharing", comm="realistic", seed=1)


def test_simulate_gives_the_episode_of_the_worker(episode: md.Episode, suite: str) -> None:
    options = md.Simulation(SCENARIO, suite=suite, comm="realistic")._config.options
    result = run_job(EpisodeJob(Path(suite), SCENARIO, AgentSpec("sharing"), 1, ScoreMode.MDRIVE, options=options))
    assert episode.digest == result.digest
    assert episode.result == result


def test_the_frame_has_a_row_per_tick_and_road_user(episode: md.Episode) -> None:
    frame, record = episode.to_frame(), episode.record
    assert len(frame) == record.valid.sum()
    last = frame[(frame.id == record.ids[0]) & (frame.tick == 40)].iloc[0]
    assert last.x == record.x[40, 0] and last.kind == "vehicle" and last.is_cav
    assert last.time_s == pytest.approx(2.0) and last.throttle == record.control_values[40, 0, 0]


def test_the_frame_of_messages_has_a_row_per_receiver(episode: md.Episode) -> None:
    frame = episode.messages_to_frame()
    assert len(frame) == sum(len(sent.deliveries) for sent in episode.record.messages) > 100
    assert {"delivered", "lost"} <= set(frame.delivery) and set(frame.type) == {"cam", "cpm"}


def test_a_plot_shows_the_cavs_of_its_tick(episode: md.Episode) -> None:
    axes = episode.plot(tick=40)
    assert {text.get_text() for text in axes.texts} >= set(episode.record.ego_ids)
    assert "tick 40 (2.00 s)" in axes.get_title()
    assert episode.plot(-1, axes) is axes
    with pytest.raises(md.InputError, match=f"expected at most {len(episode) - 1}, found {len(episode)}"):
        episode.plot(len(episode))


def test_the_replay_is_shown_in_a_frame_and_saved(episode: md.Episode, tmp_path: Path) -> None:
    page = episode.replay()
    shown = page._repr_html_()
    assert shown.startswith("<iframe srcdoc=") and "<script" not in shown
    assert page.save(tmp_path / "new" / "replay.html").read_text(encoding="utf-8") == page.html


def test_a_saved_episode_is_loaded_with_its_scenario(episode: md.Episode, suite: str, tmp_path: Path) -> None:
    again = md.load_episode(episode.save(tmp_path / "one.npz"), suite)
    assert again.digest == episode.digest and again.scenario == episode.scenario and again.seed == 1
    assert again.result == episode.result
    with pytest.raises(md.InputError, match="found no file"):
        md.load_episode(tmp_path / "other.npz")


def test_a_failing_agent_raises_with_its_own_exception_as_the_cause() -> None:
    with pytest.raises(md.AgentFailure, match=r"CAV \w+: ZeroDivisionError: tick 3") as caught:
        md.simulate(SCENARIO, agent=BrokenAgent)
    assert isinstance(caught.value.__cause__, ZeroDivisionError)


def test_a_failing_agent_ends_its_cav_on_request() -> None:
    endings = md.simulate(SCENARIO, agent=BrokenAgent, raise_agent_errors=False).record.endings
    assert {(ending.failed_tick, ending.end) for ending in endings} == {(3, End.AGENT_FAILED)}


def test_a_scenario_of_a_suite_can_be_given_itself() -> None:
    suite = md.load_suite("v2xpnp@0")  # its networks lie in the suite
    scenario = suite[0]
    assert np.isfinite(md.Simulation(scenario).briefings[scenario.egos[0].id].route_xy).all()


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"scenario": "nothing"}, "expected the id of a scenario in a packaged suite, found none"),
        ({"scenario": SCENARIO, "suite": "v2xpnp"}, "expected the id of a scenario in suite v2xpnp"),
        ({"scenario": SCENARIO, "comm": "perfect"}, "comm: expected one of ideal"),
        ({"scenario": SCENARIO, "friction": "ice"}, "friction: expected one of dry, weather, found 'ice'"),
        (
            {"scenario": SCENARIO, "frictions": "dry"},
            "frictions: unknown option, expected one of scenario, agent, .*, comm, .* did you mean 'friction'?",
        ),
        ({"scenario": SCENARIO, "agent": "nobody"}, "agent 'nobody': expected stationary"),
    ],
)
def test_unusable_arguments_are_named(options: dict[str, str], problem: str) -> None:
    with pytest.raises(md.InputError, match=problem):
        md.simulate(**options)


def test_a_simulation_has_no_agent_clock() -> None:
    with pytest.raises(md.InputError, match="agent_clock: expected none"):
        md.Simulation(SCENARIO, agent_clock="fixed:100")
