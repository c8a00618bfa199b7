"""Random takes: whatever people do, a take is driven again bit for bit, and a branch repeats its parent's begin."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from testing.sampling import examples
from testing.takes import Branch, ProgrammedActions, drive_take, list_egos, make_take

from mdrive_sumo.contract import REMARK, Control, Note
from mdrive_sumo.episode import EpisodeRecord, load_episode, save_episode
from mdrive_sumo.runs.episode_difference import find_content_difference, find_first_difference
from mdrive_sumo.runs.episode_job import make_reexecution, reexecute
from mdrive_sumo.runs.prepared_run import PreparedRun
from mdrive_sumo.runs.takes import Action, DriverChoice, RecordedActions, make_human_spec

pytestmark = pytest.mark.slow

EXAMPLES = examples(4, 60)
"""Of an example's half second: four episodes of a short scenario with two CAVs."""
LAST_TICK = 120
"""[tick] Of what happens, from the begin of the actions on."""
SUBSTITUTES = (
    "sharing",
    "single",
    "sharing+negotiation",
    "colmdriver-rule",
    "constant-speed",
    "stationary",
    "omniscient",
)

drivers = st.one_of(
    st.sampled_from(("keyboard", "wheel", "script")).map(lambda device: DriverChoice("human", {"device": device})),
    st.sampled_from(SUBSTITUTES).map(DriverChoice),
)
controls = st.builds(
    Control,
    st.floats(0, 1),
    st.one_of(st.just(0.0), st.floats(0, 1)),
    st.floats(-1, 1),
)
actions = st.builds(
    Action,
    driver=st.none() | drivers,
    texts=st.lists(st.text(st.characters(exclude_categories=["Cs"]), max_size=20), max_size=2).map(tuple),
    notes=st.lists(st.text(max_size=9).map(lambda text: Note(REMARK, text)), max_size=1).map(tuple),
)


@st.composite
def sources(
    draw: st.DrawFn, first: st.SearchStrategy[DriverChoice | None] = drivers, begin: int = 0
) -> ProgrammedActions:
    """What happens in one car from a tick on; the person may leave."""
    pedals = draw(st.lists(controls, min_size=1, max_size=5))
    at_begin = {begin: Action(draw(first))}
    later = draw(st.dictionaries(st.integers(begin + 1, begin + LAST_TICK), actions, max_size=5))
    leaves_at = draw(st.none() | st.integers(begin + 1, begin + LAST_TICK))
    return ProgrammedActions({**at_begin, **later}, lambda tick: pedals[tick // 7 % len(pedals)], leaves_at)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, suite: Path) -> PreparedRun:
    return make_take(tmp_path_factory.mktemp("random") / "take", suite, make_human_spec(SUBSTITUTES))


def drive_again(run: PreparedRun, record: EpisodeRecord) -> EpisodeRecord:
    """Drive a take from its file."""
    path = run.folder.parent / "record.npz"
    save_episode(record, path)
    return reexecute(make_reexecution(run.make_job(run.scenarios[0]), load_episode(path)))


def assert_same(record: EpisodeRecord, again: EpisodeRecord) -> None:
    assert find_first_difference(record, again) is None
    assert find_content_difference(record, again) is None
    assert record.endings == again.endings
    assert record.notes == again.notes


@settings(max_examples=EXAMPLES, suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_a_random_take_and_a_branch_of_it_are_repeated(run: PreparedRun, data: st.DataObject) -> None:
    egos = list_egos(run)
    record = drive_take(run, {ego: data.draw(sources()) for ego in egos})
    assert_same(record, drive_again(run, record))
    tick = data.draw(st.integers(1, record.ticks - 1))
    branched: dict[str, Any] = {
        ego: Branch(RecordedActions(record, ego), tick, data.draw(sources(drivers, tick))) for ego in egos
    }
    branch = drive_take(run, branched)
    assert (branch.digests[:tick] == record.digests[:tick]).all()
    assert_same(branch, drive_again(run, branch))


@settings(max_examples=EXAMPLES, suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_a_changed_control_of_a_person_is_found(run: PreparedRun, data: st.DataObject) -> None:
    record = drive_take(run, {ego: data.draw(sources()) for ego in list_egos(run)})
    column = data.draw(st.integers(0, record.egos - 1))
    tick = data.draw(st.integers(0, record.find_ending(record.ego_ids[column]).tick - 1))
    changed = record.controls.copy()
    changed[tick, column, 2] += 1 if changed[tick, column, 2] <= 0 else -1
    forged = replace(record, controls=changed)
    difference = find_first_difference(forged, drive_again(run, forged)) or find_content_difference(
        forged, drive_again(run, forged)
    )
    assert difference is not None
    assert difference.tick <= tick + 1
