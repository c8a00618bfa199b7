"""Takes that a program drives: action sources with a plan, and the drive of one take. No tests in here."""

from collections.abc import Callable, Mapping
from pathlib import Path

from mdrive_sumo.contract import Control
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.loop import run_episode
from mdrive_sumo.loop.open_world import open_world
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_job import build_episode_config, load_job_scenario
from mdrive_sumo.runs.prepared_run import PreparedRun
from mdrive_sumo.runs.run_config import RunConfig
from mdrive_sumo.runs.takes import (
    Action,
    ActionSource,
    DriverChoice,
    RecordedActions,
    make_human_spec,
    make_leaving,
    open_human_driver,
    prepare_take,
    write_take,
)

PERSON = DriverChoice("human", {"device": "script"})


class ProgrammedActions:
    """The actions of named ticks, and a control for every tick in which a person drives."""

    def __init__(
        self, actions: Mapping[int, Action], pedals: Callable[[int], Control], leaves_at: int | None = None
    ) -> None:
        self._actions, self._pedals, self._leaves_at = actions, pedals, leaves_at

    def read(self, tick: int) -> Action:
        if tick == self._leaves_at:
            raise make_leaving(tick)
        action = self._actions.get(tick, Action())
        return Action(action.driver, self._pedals(tick), action.texts, action.notes)


class Branch:
    """The actions of a recording until a tick, and other ones from then on."""

    def __init__(self, before: RecordedActions, tick: int, after: ActionSource) -> None:
        self._before, self._tick, self._after = before, tick, after

    def read(self, tick: int) -> Action:
        return (self._before if tick < self._tick else self._after).read(tick)


def drive_gently(tick: int) -> Control:
    """A control that differs from tick to tick."""
    return Control(0.3 + 0.2 * (tick % 3), 0.0, 0.01 * ((tick % 5) - 2))


def make_take(folder: Path, suite: Path, scenario: str, spec: AgentSpec | None = None) -> PreparedRun:
    """Prepare a take of a scenario of a suite."""
    spec = spec or make_human_spec(device="script")
    return prepare_take(RunConfig(suite=str(suite), scenario=scenario, agent=spec, out=folder))


def drive_take(run: PreparedRun, sources: Mapping[str, ActionSource]) -> EpisodeRecord:
    """Drive the episode of a take."""
    job = run.make_job(run.scenarios[0])
    scenario, roads = load_job_scenario(job)
    config = build_episode_config(job, scenario, roads)
    drivers = {ego.id: open_human_driver(ego.id, sources[ego.id], job.agent) for ego in scenario.egos}
    with open_world(config) as world:
        return run_episode(config, world, drivers)


def record_take(run: PreparedRun, sources: Mapping[str, ActionSource]) -> EpisodeRecord:
    """Drive and write a take."""
    record = drive_take(run, sources)
    write_take(run, record)
    return record
