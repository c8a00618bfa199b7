"""Rows of standing vehicles beside a stream, on a crossing with signals and two lanes in each direction."""

from collections.abc import Sequence

import pytest
import shapely

from mdrive_sumo.generate.hard.families import FAMILIES
from mdrive_sumo.generate.hard.hard_places import PlaceTask, draw_hard_place
from mdrive_sumo.generate.hard.sites.junction_conflicts import JunctionConflict, find_junction_conflicts
from mdrive_sumo.generate.hard.standing_rows import STEP_M, build_row
from mdrive_sumo.generate.rejection import ProposalRejected
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.start_boxes import build_user_box
from mdrive_sumo.worlds.placement.lane_chains import build_route_line
from mdrive_sumo.worlds.signalled_crossings import has_green_at_start


@pytest.fixture
def roads(tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    folder = tmp_path_factory.getbasetemp() / "hard-places"  # which test_families.py also uses
    place = draw_hard_place(PlaceTask(FAMILIES["left-turn"].places[0], "families/0", folder))
    assert place is not None
    return place.load_roads()


def list_left_turns(roads: RoadMap) -> list[JunctionConflict]:
    conflicts = find_junction_conflicts(roads)
    return [one for one in conflicts if one.own.turn == "left" and roads.lanes[one.other.approach].left]


ROW: tuple[Sequence[str], float] = (("truck", "bus", "truck"), 1.0)


def find_straight(roads: RoadMap) -> JunctionConflict:
    """Return a left turn with room for the whole row: on other streets it ends where they bend."""
    turns = list_left_turns(roads)
    return next(one for one in turns if len(build_row(roads, one, 1.6, 2.0, ROW, shapely.Polygon())) == 3)


def test_a_row_stands_beside_a_stream_and_leaves_the_way_free(roads: RoadMap) -> None:
    conflict = find_straight(roads)
    own, other = (shapely.LineString(build_route_line(roads, way.lanes).xy) for way in (conflict.own, conflict.other))
    made = build_row(roads, conflict, 1.6, 2.0, ROW, shapely.Polygon())
    row = [build_user_box(actor) for actor in made]
    assert len(row) == 3
    assert 2.0 <= row[0].distance(own) < 2.0 + 2 * STEP_M
    assert all(box.distance(own) >= 2.0 - STEP_M for box in row)
    assert all(box.distance(other) == pytest.approx(1.6, abs=0.4) for box in row)  # in a bend a corner comes nearer
    assert row[0].distance(row[1]) == pytest.approx(1.0, abs=0.1)


def test_no_vehicle_of_a_row_stands_where_it_is_closed(roads: RoadMap) -> None:
    conflict = find_straight(roads)
    first, second, _ = map(build_user_box, build_row(roads, conflict, 1.6, 2.0, ROW, shapely.Polygon()))
    closed = second.centroid.buffer(1.0)
    moved = [build_user_box(actor) for actor in build_row(roads, conflict, 1.6, 2.0, ROW, closed)]
    assert moved[0].equals(first)
    assert not any(box.intersects(closed) for box in moved)


def test_a_row_without_room_is_refused(roads: RoadMap) -> None:
    with pytest.raises(ProposalRejected, match="room for a bus 60 m beside a way"):
        build_row(roads, list_left_turns(roads)[0], 1.6, 60.0, (("bus",), 1.0), shapely.Polygon())


def test_streets_that_cross_do_not_both_have_green(roads: RoadMap) -> None:
    green = {
        one.own.approach: has_green_at_start(roads, one.own.approach, one.own.inside)
        for one in find_junction_conflicts(roads)
    }
    arms = {name.split("_")[0]: is_green for name, is_green in green.items()}
    assert arms["arm1"] == arms["arm3"] != arms["arm2"] == arms["arm4"]
