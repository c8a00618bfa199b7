"""Scenario files and suites: what is refused, with which sentence."""

import json
from pathlib import Path
from typing import Any

import pytest
from testing.worlds import straight_ego, straight_road, straight_scenario

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.scenario.checks import check_scenario
from mdrive_sumo.scenario.scenario import Scenario, load_scenario, save_scenario
from mdrive_sumo.scenario.suite import Suite, SuiteFile, load_suite, save_suite

GOOD = straight_scenario(straight_ego("0"), straight_ego("1", x=100))


def written(tmp_path: Path, change: Any) -> Path:
    data = json.loads(GOOD.model_dump_json())
    change(data)
    path = tmp_path / "scenario.json"
    path.write_text(json.dumps(data))
    return path


def test_a_saved_scenario_is_loaded_as_it_was(tmp_path: Path) -> None:
    save_scenario(GOOD, tmp_path / "s" / "scenario.json")
    assert load_scenario(tmp_path / "s" / "scenario.json") == GOOD


def test_defaults_of_speeds_and_time_limits_are_not_written(tmp_path: Path) -> None:
    """Files and checksums of scenarios from before these fields stay as they are."""
    assert "speeds" not in GOOD.model_dump_json()
    assert "time_limit_s" not in GOOD.model_dump_json()
    slow = GOOD.egos[0].model_copy(update={"time_limit_s": 12.5})
    road = Scenario.model_validate({**GOOD.model_dump(), "speeds": "road", "egos": (slow, GOOD.egos[1])})
    save_scenario(road, tmp_path / "s" / "scenario.json")
    found = load_scenario(tmp_path / "s" / "scenario.json")
    assert (found.speeds, [ego.time_limit_s for ego in found.egos]) == ("road", [12.5, None])
    assert found == road


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.update(colour="red"), r"colour: Extra inputs are not permitted, found 'red'"),
        (lambda d: d.update(format="mdrive-sumo/scenario/2"), r"format: expected 'mdrive-sumo/scenario/1'"),
        (lambda d: d.pop("egos"), "egos: Field required"),
        (lambda d: d.update(egos=[]), "egos: Tuple should have at least 1 item"),
        (
            lambda d: d["egos"][0]["start"].update(x=float("nan")),
            r"egos.0.start.x: expected a finite number, found NaN",
        ),
        (lambda d: d["egos"][0]["start"].update(x=float("inf")), r"egos.0.start.x: expected"),
        (
            lambda d: d["egos"][0]["start"].update(x=2e6),
            r"egos.0.start.x: expected less than or equal to 1000000",
        ),
        (
            lambda d: d["egos"][0]["route"].__setitem__(1, ["a", 0, 0]),
            "egos.0.route.1.0: expected a valid number",
        ),
        (lambda d: d["egos"][0]["route"].__setitem__(1, [500, 0, 0]), "found 490.00 m after point 0"),
        (lambda d: d["egos"][0]["route"].__setitem__(1, [10, 0, 0]), r"over 0, at most 1.5 m"),
        (lambda d: d["egos"][1].update(id="0"), "expected every road user to have its own id, found twice: 0"),
        (lambda d: d["egos"][0].update(id="../x"), "egos.0.id: String should match pattern"),
        (lambda d: d.update(signals="off"), "signals: expected 'frozen-green' or 'program'"),
        (lambda d: d.update(speeds="fast"), "speeds: expected 'protocol' or 'road', found 'fast'"),
        (lambda d: d["egos"][0].update(time_limit_s=0), "egos.0.time_limit_s: expected greater than 0, found 0"),
        (lambda d: d.update(background={"action_step_s": 0}), "background.action_step_s: expected greater"),
    ],
)
def test_a_bad_scenario_gets_one_sentence(tmp_path: Path, change: Any, message: str) -> None:
    path = written(tmp_path, change)
    with pytest.raises(InputError, match=message) as caught:
        load_scenario(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)
    assert "Value error" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "{", "[]", "\x00\x01"])
def test_what_is_no_json_object_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "scenario.json").write_text(text)
    with pytest.raises(InputError, match=r"scenario\.json: "):
        load_scenario(tmp_path / "scenario.json")


def changed(**ego: Any) -> Scenario:
    return straight_scenario(straight_ego("0").model_copy(update=ego))


@pytest.mark.parametrize(
    ("scenario", "message"),
    [
        (changed(lanes=("nowhere_0",)), "expected lanes of network straight, found 'nowhere_0'"),
        (changed(lanes=("r_0", "r_0")), "expected a lane after or beside r_0, found r_0, which is not connected"),
        (
            changed(route=straight_ego("0", y=9.0).route),
            r"route point 0 \(10.0, 9.0\): expected within 4 m of its lanes, found 9.0 m",
        ),
        (
            changed(start=straight_ego("0", x=20).start),
            "start: expected within 2 m of the first route point, found 10.0 m",
        ),
    ],
)
def test_a_scenario_that_does_not_fit_its_network_is_refused(scenario: Scenario, message: str) -> None:
    check_scenario(GOOD, straight_road())
    with pytest.raises(InputError, match=message):
        check_scenario(scenario, straight_road())


def suite(folder: Path) -> Suite:
    about = SuiteFile(name="mine", title="Mine")
    made = Suite(about, folder, tuple(GOOD.model_copy(update={"id": f"r{i}_x"}) for i in (1, 2, 10)))
    save_suite(made)
    return made


def test_a_saved_suite_is_loaded_in_the_order_of_its_numbers(tmp_path: Path) -> None:
    made = suite(tmp_path / "mine")
    loaded = load_suite(str(tmp_path / "mine"))
    assert loaded == made
    assert [scenario.id for scenario in loaded.scenarios] == ["r1_x", "r2_x", "r10_x"]
    assert loaded.checksum() == made.checksum()
    assert [scenario.id for scenario in loaded.select("r1*")] == ["r1_x", "r10_x"]
    with pytest.raises(InputError, match="expected a scenario id or category like 'z', found none"):
        loaded.select("z")


def test_the_checksum_covers_every_scenario(tmp_path: Path) -> None:
    made = suite(tmp_path / "mine")
    path = tmp_path / "mine" / "r2_x" / "scenario.json"
    path.write_text(path.read_text().replace('"yaw":0.0', '"yaw":0.001', 1))
    assert load_suite(str(tmp_path / "mine")).checksum() != made.checksum()


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda folder: (folder / "suite.json").unlink(), r"suite\.json: cannot be read"),
        (lambda folder: (folder / "suite.json").write_text("{}"), "name: Field required"),
        (
            lambda folder: (folder / "r1_x").rename(folder / "r3_x"),
            r"id: expected 'r3_x', the name of its folder, found 'r1_x'",
        ),
    ],
)
def test_a_damaged_suite_gets_one_sentence(tmp_path: Path, damage: Any, message: str) -> None:
    suite(tmp_path / "mine")
    damage(tmp_path / "mine")
    with pytest.raises(InputError, match=message):
        load_suite(str(tmp_path / "mine"))


def test_a_missing_or_empty_suite_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"suite '/nowhere': expected a folder or one of"):
        load_suite("/nowhere")
    (tmp_path / "suite.json").write_text('{"name": "x", "title": "x"}')
    with pytest.raises(InputError, match=r"expected scenarios in <id>/scenario\.json, found none"):
        load_suite(str(tmp_path))


def test_seeds_depend_on_names_only() -> None:
    assert derive_seed(0, "a", "sumo") == derive_seed(0, "a", "sumo")
    assert len({derive_seed(s, a, b) for s in (0, 1) for a in ("a", "b") for b in ("sumo", "x")}) == 8
    assert derive_seed(0, "ab", "c") != derive_seed(0, "a", "bc")
    assert all(0 <= derive_seed(s, "x") < 2**31 for s in range(200))
