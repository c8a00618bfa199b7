"""Demonstrations of people: a data set of what they were shown and did, from takes."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from testing.short_suite import make_short_suite
from testing.takes import (
    PERSON,
    SCENARIO,
    SHARING,
    Branch,
    ProgrammedActions,
    change_control,
    forge,
    invoke,
    let_drive,
    list_egos,
    load_recorded,
    make_take,
    record_take,
)

from mdrive_sumo.contract import Control, Observation
from mdrive_sumo.export.demonstration_tables import TABLES
from mdrive_sumo.export.demonstrations import export_demonstrations, load_takes
from mdrive_sumo.runs.takes import Action, RecordedActions, make_human_spec, observe_take
from mdrive_sumo.scoring import load_results

if TYPE_CHECKING:
    import pandas as pd

pytestmark = pytest.mark.usefixtures("in_process")
BRANCH_TICK = 50
HANDED_OVER = range(30, 60)


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of two takes; the second one branches off the first, in which an agent drives from 1.5 s to 3 s."""
    folder = tmp_path_factory.mktemp("drive")
    suite = make_short_suite(folder / "suite", SCENARIO, metres=20)
    spec = make_human_spec(device="script", latency_ms=41.5)
    run = make_take(folder / "takes" / "1", suite, spec)
    actions = {
        0: Action(PERSON, texts=("hello",)),
        HANDED_OVER.start: Action(SHARING),
        HANDED_OVER.stop: Action(PERSON),
    }
    first = record_take(run, let_drive(list_egos(run), ProgrammedActions(actions)))
    brakes = ProgrammedActions({BRANCH_TICK: Action(PERSON)}, lambda _: Control(0.1, 0.2, 0.0), leaves_at=90)
    before = {ego: RecordedActions(first, ego) for ego in first.ego_ids}
    sources = {
        first.ego_ids[0]: Branch(before[first.ego_ids[0]], BRANCH_TICK, brakes),
        first.ego_ids[1]: Branch(
            before[first.ego_ids[1]], BRANCH_TICK, ProgrammedActions({BRANCH_TICK: Action(PERSON)})
        ),
    }
    record_take(make_take(folder / "takes" / "2", suite, spec), sources)
    return folder


@pytest.fixture(scope="module")
def tables(drive: Path) -> Mapping[str, "pd.DataFrame"]:
    import pandas as pd

    ended = invoke("export", drive, "--demonstrations", "--format", "csv", "--out", drive / "csv")
    assert ended.exit_code == 0, ended.output
    return {
        table.name: pd.read_csv(
            drive / "csv" / f"{table.name}.csv", dtype={"cav": str, "sender": str, "id": str, "folder": str}
        )
        for table in TABLES
    }


def test_steps_are_the_ticks_in_which_a_person_drove(drive: Path, tables: Mapping[str, "pd.DataFrame"]) -> None:
    record = load_recorded(drive / "takes" / "1")
    steps = tables["steps"].query(f"episode == '{record.digest}'")
    last = record.find_ending("0").tick
    assert set(steps.cav) == {"0"}
    assert steps.tick.tolist() == [tick for tick in range(last) if tick not in HANDED_OVER]
    done = record.control_values[steps.tick, 0]
    assert np.abs(steps[["throttle", "brake", "steer"]].to_numpy() - done).max() < 1e-9
    truth = np.stack([values[steps.tick, 0] for values in (record.x, record.y, record.yaw, record.speed)], axis=-1)
    assert np.abs(steps[["true_x", "true_y", "true_yaw", "true_speed"]].to_numpy() - truth).max() < 1e-9
    apart = np.hypot(steps.x - steps.true_x, steps.y - steps.true_y)
    assert 0.0 < apart.max() < 1.0  # an estimate
    assert steps.route_s.is_monotonic_increasing or np.diff(steps.route_s).min() > -0.5
    assert set(steps.device) == {"script"}


def test_a_tick_shows_what_an_agent_is_shown(drive: Path, tables: Mapping[str, "pd.DataFrame"]) -> None:
    (stored, _) = load_takes(drive / "takes")
    record = load_recorded(drive / "takes" / "1")
    seen: dict[int, Observation] = {}
    job = stored.run.make_job(stored.run.scenarios[0])
    observe_take(job, record, lambda tick, shown: seen.update({tick: shown["0"]} if "0" in shown else {}))
    objects = tables["objects"].query(f"episode == '{record.digest}' and cav == '0'")
    own = objects.query("source == 'sensor'")
    assert len(own) > 0
    for tick in (10, 20, 80):
        told = seen[tick].objects
        assert told is not None
        rows = own.query(f"tick == {tick}")
        assert rows.id.tolist() == list(told.ids)
        assert np.abs(rows[["x", "y"]].to_numpy() - np.stack((told.x, told.y), axis=-1)).max() < 1e-4
        assert tables["steps"].query(f"episode == '{record.digest}' and tick == {tick}").x.tolist() == [
            pytest.approx(seen[tick].own.x, abs=1e-4)
        ]
    assert set(objects[objects.source != "sensor"].sender) == {"1"}
    assert {"cam", "cpm"} <= set(objects.source)


def test_ticks_before_a_branch_count_once(drive: Path, tables: Mapping[str, "pd.DataFrame"]) -> None:
    takes, steps = tables["takes"], tables["steps"]
    branch = load_recorded(drive / "takes" / "2")
    rows = takes[takes.folder == "2"].set_index("cav")
    assert rows.repeated.to_dict() == {"0": HANDED_OVER.start, "1": 0}
    assert rows.loc["0", "ticks"] == 90 - BRANCH_TICK
    assert steps.query(f"episode == '{branch.digest}' and cav == '0'").tick.min() == BRANCH_TICK
    assert takes.ticks.sum() == len(steps)
    assert not steps.duplicated(["episode", "cav", "tick"]).any()
    assert rows.loc["0", "reason"] == "left: the person left at tick 90 (4.50 s)"
    score = load_results(drive / "takes" / "2" / "results.json").scenarios[0].egos[0]
    assert rows.loc["0", "ds"] == pytest.approx(score.ds)
    assert set(takes.latency_ms) == {41.5}


def test_texts_and_routes(drive: Path, tables: Mapping[str, "pd.DataFrame"]) -> None:
    assert tables["texts"][["cav", "tick", "sender", "text"]].to_numpy().tolist() == [["0", 0, "0", "hello"]]
    routes = tables["routes"]
    assert routes.groupby(["episode", "cav"]).s.max().min() > 15
    assert (routes.speed_limit > 5).all()


def test_parquet_has_the_rows_of_csv_and_says_the_units(drive: Path, tables: Mapping[str, "pd.DataFrame"]) -> None:
    from pyarrow import parquet

    out = export_demonstrations(load_takes(drive / "takes"), "parquet", drive / "parquet")
    package = json.loads((drive / "csv" / "datapackage.json").read_text())
    assert [one["name"] for one in package["resources"]] == [table.name for table in TABLES]
    for table in TABLES:
        found = parquet.read_table(out / f"{table.name}.parquet")
        assert found.num_rows == len(tables[table.name])
        assert {field.name: field.metadata[b"unit"].decode() for field in found.schema} == {
            column.name: column.unit for column in table.columns
        }


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("{drive}/takes/1", "--format", "mcap"), "--format: expected one of csv, parquet, found 'mcap'"),
        (("{drive}/nowhere", "--format", "csv"), "expected a folder that `mdrive-sumo eval` has written"),
        (("{other}", "--format", "csv"), "expected a take, which a person drives, found runs of stationary only"),
        (("{agents}", "--format", "csv"), "expected ticks in which a person drives, found none"),
        (("{forged}", "--format", "csv"), "expected the episode of its recording, found another one from tick 10 on"),
        (("{drive}/takes", "--format", "csv", "--scenario", "i02"), "expected an id, category or glob"),
    ],
)
def test_what_is_no_demonstration(drive: Path, tmp_path: Path, words: tuple[str, ...], says: str) -> None:
    places = {"drive": drive, "other": tmp_path / "other", "agents": tmp_path / "agents", "forged": tmp_path / "forged"}
    suite = drive / "suite"
    if words[0] == "{other}":
        made = invoke("eval", "--suite", suite, "--agent", "stationary", "--workers", 1, "--out", places["other"])
        assert made.exit_code == 0, made.output
    elif words[0] in ("{agents}", "{forged}"):
        run = make_take(places[words[0].strip("{}")], suite)
        begin = SHARING if words[0] == "{agents}" else PERSON
        record_take(run, let_drive(list_egos(run), ProgrammedActions({0: Action(begin)})))
        if words[0] == "{forged}":
            forge(run.folder, lambda record: change_control(record, 10))
    ended = invoke("export", *(word.format(**places) for word in words), "--demonstrations", "--out", tmp_path / "out")
    assert (ended.exit_code, ended.stderr.count("\n")) == (2, 1), ended.output
    assert says in ended.stderr
    assert not (tmp_path / "out").exists()


def test_open_loop_compares_where_a_person_drove(drive: Path, tmp_path: Path) -> None:
    words = ("eval-open", "--reference", drive / "takes" / "1", "--agent", "constant-speed", "--out", tmp_path / "out")
    ended = invoke(*words)
    assert ended.exit_code == 0, ended.output
    (scenario,) = json.loads((tmp_path / "out" / "open_loop.json").read_text())["scenarios"]
    last = load_recorded(drive / "takes" / "1").find_ending("0").tick
    compared = [tick for tick in range(HANDED_OVER.stop, last, 4) if tick + 60 < last]
    assert scenario["frames"] == len(compared) > 0
    assert scenario["skipped"]["no 3 s of a person"] > 0
