"""Takes that a program drives: action sources with a plan, and the drive of one take. No tests in here."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from click.testing import CliRunner, Result

from mdrive_sumo.cli import main
from mdrive_sumo.contract import DRIVER, Control, Note
from mdrive_sumo.core.checksum import compute_file_checksum
from mdrive_sumo.episode import EpisodeRecord, NoteRecord, load_episode, save_episode
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
from testing.journals import rewrite_journal

SCENARIO = "i01_*"
"""Of the short suite: two CAVs at a crossing."""
PERSON = DriverChoice("human", {"device": "script"})
SHARING = DriverChoice("sharing")


def invoke(*words: str | Path | int) -> Result:
    """Run a command line of the program."""
    return CliRunner().invoke(main, [str(word) for word in words])


def drive_gently(tick: int) -> Control:
    """A control that differs from tick to tick."""
    return Control(0.3 + 0.2 * (tick % 3), 0.0, 0.01 * ((tick % 5) - 2))


class ProgrammedActions:
    """The actions of named ticks, and a control for every tick in which a person drives."""

    def __init__(
        self,
        actions: Mapping[int, Action],
        pedals: Callable[[int], Control] = drive_gently,
        leaves_at: int | None = None,
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


def make_take(folder: Path, suite: Path, spec: AgentSpec | None = None, scenario: str = SCENARIO) -> PreparedRun:
    """Prepare a take of a scenario of a suite."""
    spec = spec or make_human_spec(device="script")
    return prepare_take(RunConfig(suite=str(suite), scenario=scenario, agent=spec, out=folder))


def list_egos(run: PreparedRun) -> tuple[str, ...]:
    """The CAVs of a take."""
    return tuple(ego.id for ego in run.scenarios[0].egos)


def let_drive(egos: Sequence[str], first: ActionSource, others: DriverChoice = SHARING) -> dict[str, ActionSource]:
    """The first CAV acts as said, an agent drives the others."""
    rest: dict[str, ActionSource] = {ego: ProgrammedActions({0: Action(others)}) for ego in egos[1:]}
    return {egos[0]: first, **rest}


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


def load_recorded(folder: Path) -> EpisodeRecord:
    """The only recording of a run folder."""
    (path,) = (folder / "episodes").glob("*.npz")
    return load_episode(path)


def forge(folder: Path, change: Callable[[EpisodeRecord], EpisodeRecord]) -> None:
    """Change a recording, and its checksum in the journal, as a person who has read the source can."""
    (path,) = (folder / "episodes").glob("*.npz")
    before = compute_file_checksum(path)
    save_episode(change(load_recorded(folder)), path)
    rewrite_journal(folder / "journal.jsonl", lambda line: line.replace(before, compute_file_checksum(path)))


def change_control(record: EpisodeRecord, tick: int, step: int = 500) -> EpisodeRecord:
    controls = record.controls.copy()
    controls[tick, 0, 0] += step
    return replace(record, controls=controls)


def change_note(record: EpisodeRecord, index: int, text: str) -> EpisodeRecord:
    """Change the text of a driver note of the first CAV."""
    places = [i for i, one in enumerate(record.notes) if one.note.kind == DRIVER and one.ego == record.ego_ids[0]]
    notes = list(record.notes)
    one = notes[places[index]]
    notes[places[index]] = NoteRecord(one.tick, one.ego, Note(DRIVER, text))
    return replace(record, notes=tuple(notes))


def drop_notes(record: EpisodeRecord, kind: str) -> EpisodeRecord:
    return replace(record, notes=tuple(one for one in record.notes if one.note.kind != kind))
