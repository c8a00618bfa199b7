"""Scenarios written by hand: routes, road users, and one sentence for each mistake."""

from collections.abc import Callable
from pathlib import Path

import pytest

import mdrive_sumo as md
from mdrive_sumo.scenario.scripted_actor import DistanceTrigger, HardBrake, LaneMotion
from mdrive_sumo.worlds import ScenarioBuilder, World

LEFT_TURN = "south_in_1 -45 > west_out_1 30"
Mistake = Callable[[ScenarioBuilder], object]


@pytest.fixture(scope="module")
def world() -> World:
    return md.worlds.load("old_town")


@pytest.fixture
def draft(world: World) -> ScenarioBuilder:
    draft = world.new_scenario("left_turn")
    draft.add_cav(LEFT_TURN, "red")
    return draft


def locate(world: World, lane: str, s: float) -> tuple[float, float]:
    x, y = world.roads.lanes[lane].centre.at(s)
    return x + 0.4, y - 0.6


def test_a_scenario_of_ten_lines_holds_what_was_added(world: World, draft: ScenarioBuilder) -> None:
    assert draft.add_cav("north_in_1 -40 > south_out_1 30") == "cav0"
    draft.add_vehicle("west_in_1 20 > east_out_1 50", model="bus")
    draft.add_scripted_vehicle("east_in_1 20 > west_out_1 60", speed=8.0, when=md.worlds.near("red"), then="brake")
    draft.add_pedestrian((-40.0, -20.0), (-46.0, -8.0), when=md.worlds.near("red", 20.0))
    assert draft.add_parked_row("south_in_1", -40, -15) == "parked0"
    draft.add_prop("cone", locate(world, "west_out_1", 60))
    draft.add_rsu((10.0, 10.0))
    scenario = draft.build()
    assert isinstance(scenario, md.Scenario)
    assert [ego.id for ego in scenario.egos] == ["red", "cav0"]
    assert scenario.egos[0].lanes == ("south_in_1", ":x_5_0", "west_out_1")
    (bus,) = scenario.background.vehicles
    assert (bus.edges, bus.depart_pos_m, bus.length) == (("west_in", "east_out"), 26.0, 12.0)
    braking = scenario.actors[0]
    assert isinstance(braking.motion, LaneMotion) and isinstance(braking.action, HardBrake)
    walker = next(actor for actor in scenario.actors if actor.kind == "pedestrian")
    assert walker.trigger == DistanceTrigger(vehicle="red", distance_m=20.0)
    parked = [actor.id for actor in scenario.actors if actor.id.startswith("parked")]
    assert parked == ["parked0.0", "parked0.1", "parked0.2", "parked0.3"]  # of 4.6 m in 25 m, 1.2 m apart
    assert [unit.id for unit in scenario.rsus] == ["rsu0"]


def test_points_stand_for_the_lanes_that_lead_through_them(world: World, draft: ScenarioBuilder) -> None:
    """In the middle of a crossing a point lies on many lanes: the one on the way from start to goal is meant."""
    draft.add_cav([locate(world, "south_in_1", 10), (1.0, 0.0), locate(world, "north_out_1", 20)], "points")
    x, y = locate(world, "east_out_1", 60)
    draft.add_cav(f"west_in_1 40 > {x:.1f},{y:.1f}", "mixed")
    points, mixed = draft.build().egos[1:]
    assert points.lanes == ("south_in_1", ":x_4_0", "north_out_1")
    assert mixed.lanes == ("west_in_1", ":x_7_0", "east_out_1")
    assert points.start.x == pytest.approx(world.roads.lanes["south_in_1"].centre.at(10)[0], abs=1.0)


def test_drawn_traffic_leaves_room_for_what_is_there(draft: ScenarioBuilder) -> None:
    draft.add_traffic("town-quiet", seed=3)
    scenario = draft.build()
    assert len(scenario.background.vehicles) > 0
    assert draft.build() == scenario


@pytest.mark.slow
def test_the_suite_folder_grows_and_brings_its_network(tmp_path: Path) -> None:
    world = md.worlds.draw(place="crossing", seed=7, folder=tmp_path / "place")
    entry, exit_ = (next(name for name in world.roads.lanes if f"_{way}_" in name) for way in ("in", "out"))
    exits = [name for name in world.roads.lanes if "_out_" in name and name.split("_")[0] != entry.split("_")[0]]
    for name, goal in zip(("one", "two"), exits[:2], strict=True):
        draft = world.new_scenario(name)
        draft.add_cav(f"{entry} -40 > {goal} 30")
        draft.save(tmp_path / "suite")
    suite = md.load_suite(str(tmp_path / "suite"))
    assert [scenario.id for scenario in suite] == ["one", "two"]
    with md.Simulation("two", suite=suite) as simulation:
        assert simulation.reset()
    other = md.worlds.draw(place="crossing", seed=8, folder=tmp_path / "place_8")
    assert exit_ and other.name != world.name


MISTAKES: dict[str, tuple[Mistake, str]] = {
    "no such lane": (
        lambda draft: draft.add_cav("south_in_2 -45 > west_out_1 30"),
        "scenario left_turn: cav0: expected a car lane of network old_town, found 'south_in_2';"
        " did you mean 'south_in_1'?",
    ),
    "unreachable goal": (
        lambda draft: draft.add_cav("west_out_1 3 > south_in_1 10"),
        "expected a way from lane west_out_1 to lane south_in_1, found none",
    ),
    "unreachable point": (
        lambda draft: draft.add_cav([draft.roads.lanes["west_out_1"].centre.at(40), (20.0, -80.0)]),
        r"cav0: route: (goal \(20\.0, -80\.0\): expected a place on the road|expected a way from)",
    ),
    "goal behind the start": (
        lambda draft: draft.add_cav("south_in_1 -45 > south_in_1 -60"),
        "expected the goal ahead of the start, found 21.4 m behind 36.4 m of south_in_1",
    ),
    "start off the road": (
        lambda draft: draft.add_cav("500,500 > west_out_1 30"),
        r"start \(500\.0, 500\.0\): expected a place on the road, found the nearest lane, north_out_1, 644\.\d m away",
    ),
    "no arc length": (
        lambda draft: draft.add_cav("south_in_1 > west_out_1 30"),
        "expected an arc length for start and goal, found 'south_in_1' without",
    ),
    "beyond the lane": (
        lambda draft: draft.add_cav("south_in_1 900 > west_out_1 3"),
        "arc length from -81.4 to 81.4 m",
    ),
    "no goal": (lambda draft: draft.add_cav("south_in_1 9"), "expected a start and a goal with '>' between them"),
    "no route": (lambda draft: draft.add_cav(7), "expected a text or a list of steps, found 7"),  # pyright: ignore[reportArgumentType]
    "no steps": (
        lambda draft: draft.add_cav("a b c > d"),
        "expected steps 'lane .arc length.' or 'x,y', found 'a b c'",
    ),
    "no numbers": (lambda draft: draft.add_cav("1,nan > 2,3"), "expected a point .x, y. in metres, found"),
    "taken id": (
        lambda draft: draft.add_cav(LEFT_TURN, "red"),
        "id: expected one of its own for every road user, found 'red' twice",
    ),
    "bad id": (lambda draft: draft.add_cav(LEFT_TURN, "a b"), "a b: id: String should match pattern"),
    "model": (
        lambda draft: draft.add_vehicle(LEFT_TURN, model="buss"),  # pyright: ignore[reportArgumentType]
        "model: expected one of car, van, .*did you mean 'bus'",
    ),
    "no room": (
        lambda draft: draft.add_vehicle("south_in_1 80 > west_out_1 30"),
        "expected room for its 4.6 m on lane",
    ),
    "short row": (lambda draft: draft.add_parked_row("south_in_1", 0, 2), "expected at least 4.6 m for one car"),
    "behaviour": (
        lambda draft: draft.add_scripted_vehicle(LEFT_TURN, speed=5.0, then="brak"),  # pyright: ignore[reportArgumentType]
        "then: expected one of start, brake, .*did you mean 'brake'",
    ),
    "one point": (lambda draft: draft.add_pedestrian((0.0, 0.0)), "expected a start and a goal, found 1 points"),
    "prop": (lambda draft: draft.add_prop("con", (0.0, 0.0)), "did you mean 'cone'"),
    "demand": (lambda draft: draft.add_traffic("town"), "traffic: .*town-quiet"),
    "far trigger": (lambda _: md.worlds.near("red", 500), "less than or equal to 50, found 500"),
    "no such place": (lambda _: md.worlds.when_at("red", 4), "expected a point"),  # pyright: ignore[reportArgumentType]
    "no such network": (lambda _: md.worlds.load("oldtown"), "found neither; did you mean 'old_town'"),
    "no such kind": (lambda _: md.worlds.draw(place="crosing"), "did you mean 'crossing'"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_one_sentence(draft: ScenarioBuilder, name: str) -> None:
    make, sentence = MISTAKES[name]
    with pytest.raises(md.InputError, match=sentence) as caught:
        make(draft)
    assert "\n" not in str(caught.value)
    assert len(draft.build().egos) == 1, "what is wrong is not added"


def test_what_is_only_wrong_together_is_found_at_the_end(world: World, draft: ScenarioBuilder) -> None:
    with pytest.raises(md.InputError, match="expected at least one CAV, found none; add_cav adds one"):
        world.new_scenario("empty").build()
    draft.add_pedestrian((-40.0, -20.0), (-46.0, -8.0), when=md.worlds.near("read"))
    with pytest.raises(md.InputError, match="expected one of the CAVs red, found 'read'"):
        draft.build()
    other = world.new_scenario("other")
    other.add_cav(LEFT_TURN, "red")
    other.add_cav("south_in_1 -43 > west_out_1 30", "blue")
    with pytest.raises(md.InputError, match="scenario other: CAV red and CAV blue start inside each other"):
        other.build()


def test_a_folder_of_something_else_is_left_alone(tmp_path: Path, draft: ScenarioBuilder) -> None:
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(md.InputError, match="expected a suite's folder, or a new or empty one"):
        draft.save(tmp_path)
    sealed = md.load_suite("interdrive@0").folder
    with pytest.raises(md.InputError, match="expected a suite that may grow, found a sealed suite"):
        draft.save(sealed)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


def test_a_map_file_names_the_command_that_converts_it(tmp_path: Path) -> None:
    (tmp_path / "town.osm").write_text("<osm/>")
    with pytest.raises(md.InputError, match=r"`mdrive-sumo convert network .*town\.osm --out DIR` makes one of it"):
        md.worlds.load(tmp_path / "town.osm")
