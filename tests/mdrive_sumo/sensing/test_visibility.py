"""Line of sight against rays that shapely casts, against hand calculation, and its symmetries."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from testing.sampling import examples
from testing.twins import compare_twins
from testing.worlds import straight_road

from mdrive_sumo.contract import Objects
from mdrive_sumo.core.geometry import TAU, Float, box_corners, boxes_corners
from mdrive_sumo.core.state import Kind
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.roads.network_file import Building
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose
from mdrive_sumo.sensing.visibility import BuildingEdges, SightView

Box = tuple[Kind, float, float, float, float, float]
"""Kind, x, y, yaw, length, width."""
HERE = SensorPose(0.0, 0.0, 0.0, None)
RAYS = 300


def scene(*boxes: Box) -> SensingFrame:
    table = np.array([box[1:] for box in boxes], dtype=np.float64).reshape(-1, 5)
    kind = np.array([box[0] for box in boxes], dtype=np.uint8)
    ids = tuple(f"b{i}" for i in range(len(boxes)))
    x, y, yaw, length, width = table.T
    return SensingFrame(0, Objects(ids, kind, x, y, yaw, np.zeros(len(boxes)), length, width), {})


def town(*outlines: list[tuple[float, float]]) -> RoadMap:
    return replace(
        straight_road(), buildings=tuple(Building(id=f"h{i}", polygon=tuple(o)) for i, o in enumerate(outlines))
    )


def house(x: float, y: float, yaw: float = 0.0, length: float = 10.0, width: float = 10.0) -> list[tuple[float, float]]:
    return [(float(a), float(b)) for a, b in box_corners(x, y, yaw, length, width)]


def shares(
    *boxes: Box, houses: tuple[list[tuple[float, float]], ...] = (), eye: SensorPose = HERE, reach: float = 100.0
) -> Float:
    return SightView(eye, scene(*boxes), BuildingEdges(town(*houses)), reach).visible_fractions()


def first_hits(shape: shapely.Geometry, eye: SensorPose, angles: Float) -> Float:
    """Distance to the shape along each ray, infinite where it is missed."""
    ends = np.stack((eye.x + 300 * np.cos(angles), eye.y + 300 * np.sin(angles)), axis=-1)
    rays = shapely.linestrings(np.stack((np.broadcast_to((eye.x, eye.y), ends.shape), ends), axis=-2))
    met = shapely.intersection(rays, shape)
    return np.where(shapely.is_empty(met), np.inf, shapely.distance(met, shapely.Point(eye.x, eye.y)))


def hides(view: SensingFrame, row: int) -> bool:
    """Cars, and what is static and not low."""
    boxes = view.boxes
    high = max(boxes.length[row], boxes.width[row]) > 2.5
    return boxes.kind[row] == Kind.VEHICLE or (boxes.kind[row] == Kind.STATIC and high)


def corners_of(view: SensingFrame) -> Float:
    boxes = view.boxes
    return boxes_corners(boxes.x, boxes.y, boxes.yaw, boxes.length, boxes.width)


def share_by_rays(view: SensingFrame, roads: RoadMap, eye: SensorPose, row: int) -> float:
    """The visible share of one box by brute force."""
    corners = corners_of(view)
    shapes = [shapely.Polygon(ring) for ring in corners]
    angles = np.arctan2(corners[row, :, 1] - eye.y, corners[row, :, 0] - eye.x)
    angles = angles[0] + (angles - angles[0] + math.pi) % TAU - math.pi
    rays = angles.min() + (np.arange(RAYS) + 0.5) / RAYS * np.ptp(angles)
    hit = first_hits(shapes[row], eye, rays)
    opaque = [i for i in range(len(shapes)) if hides(view, i) and i not in (row, eye.carrier_row)]
    for shape in [*(shapes[i] for i in opaque), *roads.building_shapes]:
        hit = np.where(first_hits(shape, eye, rays) < hit - 1e-9, np.nan, hit)
    return float(np.isfinite(hit).mean())


def boxes_around(count: int) -> st.SearchStrategy[list[Box]]:
    """Boxes that do not contain the origin; they may overlap each other."""
    box = st.tuples(
        st.sampled_from(list(Kind)),
        st.floats(5.0, 40.0),
        st.floats(-math.pi, math.pi),
        st.floats(-math.pi, math.pi),
        st.floats(0.4, 8.0),
        st.floats(0.4, 3.0),
    )
    return st.lists(
        box.map(lambda b: (b[0], b[1] * math.cos(b[2]), b[1] * math.sin(b[2]), b[3], b[4], b[5])),
        min_size=1,
        max_size=count,
    )


HOUSES = st.lists(
    st.tuples(st.floats(12.0, 40.0), st.floats(-math.pi, math.pi), st.floats(0.0, 3.0)).map(
        lambda h: house(h[0] * math.cos(h[1]), h[0] * math.sin(h[1]), h[2])
    ),
    max_size=3,
)


class TestAgainstRays:
    @pytest.mark.slow
    @settings(max_examples=examples(15, 50), deadline=None)
    @given(boxes=boxes_around(10), houses=HOUSES, clockwise=st.booleans())
    def test_any_scene(self, boxes: list[Box], houses: list[list[tuple[float, float]]], clockwise: bool) -> None:
        roads = town(*(h[::-1] if clockwise else h for h in houses))
        view = scene(*boxes)
        shares = SightView(HERE, view, BuildingEdges(roads), 200.0).visible_fractions()
        brute = [share_by_rays(view, roads, HERE, row) for row in range(len(boxes))]
        assert shares == pytest.approx(np.array(brute), abs=6.1 / RAYS)

    @settings(max_examples=examples(8, 25), deadline=None)
    @given(boxes=boxes_around(8), houses=HOUSES, yaw=st.floats(-4.0, 4.0))
    def test_free_sight(self, boxes: list[Box], houses: list[list[tuple[float, float]]], yaw: float) -> None:
        eye, roads, view = SensorPose(0.0, 0.0, yaw, None), town(*houses), scene(*boxes)
        angles = yaw + np.arange(24) * TAU / 24
        brute = np.full(24, 35.0)
        for row, shape in enumerate(corners_of(view)):
            if hides(view, row):
                brute = np.minimum(brute, first_hits(shapely.Polygon(shape), eye, angles))
        for shape in roads.building_shapes:
            brute = np.minimum(brute, first_hits(shape, eye, angles))
        assert SightView(eye, view, BuildingEdges(roads), 35.0).free_sight(24) == pytest.approx(brute, abs=1e-6)

    def test_house_with_a_courtyard_entrance(self) -> None:
        """A wall that goes around three sides hides what is behind it, not what stands in the opening."""
        ring = [
            (10.0, -10.0),
            (30.0, -10.0),
            (30.0, 10.0),
            (10.0, 10.0),
            (10.0, 8.0),
            (28.0, 8.0),
            (28.0, -8.0),
            (10.0, -8.0),
        ]
        inside, behind = (Kind.VEHICLE, 20.0, 0.0, 0.0, 4.0, 2.0), (Kind.VEHICLE, 40.0, 0.0, 0.0, 4.0, 2.0)
        assert shares(inside, behind, houses=(ring,)).tolist() == [1.0, 0.0]


class TestByHand:
    def test_alone_is_wholly_visible(self) -> None:
        assert shares((Kind.VEHICLE, 20.0, 5.0, 1.0, 5.0, 2.0)).tolist() == [1.0]

    def test_half_hidden(self) -> None:
        """A wide thing at 10 m covers all left of straight ahead; half of what lies behind stays."""
        screen = (Kind.STATIC, 10.0, 5.0, 0.0, 1.0, 10.0)
        assert shares((Kind.VEHICLE, 20.0, 0.0, 0.0, 4.0, 2.0), screen) == pytest.approx([0.5, 1.0])

    def test_share_is_of_the_angle(self) -> None:
        """The target spans y = -2 .. 2 at 20 m, and a screen that ends at y = 0.5 at 10 m leaves y > 1 at 20 m."""
        seen = shares((Kind.VEHICLE, 20.5, 0.0, 0.0, 1.0, 4.0), (Kind.VEHICLE, 10.5, -4.5, 0.0, 1.0, 10.0))
        expected = (math.atan(2 / 20) - math.atan(0.5 / 10)) / (2 * math.atan(2 / 20))
        assert seen[0] == pytest.approx(expected)

    def test_overlapping_boxes_cross(self) -> None:
        """Two diagonal planks form an X at 20 m: each shows the half that is in front, less the other's thickness."""
        planks = [(Kind.STATIC, 20.0, 0.0, turn, 10.0, 0.01) for turn in (math.pi / 4, -math.pi / 4)]
        assert shares(*planks) == pytest.approx([0.5, 0.5], abs=0.12)
        assert shares(*planks) == pytest.approx(
            [share_by_rays(scene(*planks), town(), HERE, i) for i in (0, 1)], abs=0.01
        )

    @pytest.mark.parametrize("kind", [Kind.PEDESTRIAN, Kind.CYCLIST])
    def test_people_hide_nothing(self, kind: Kind) -> None:
        assert shares((kind, 10.0, 0.0, 0.0, 3.0, 3.0), (Kind.VEHICLE, 20.0, 0.0, 0.0, 4.0, 2.0)).tolist() == [1.0, 1.0]

    @pytest.mark.parametrize(("side", "share"), [(0.4, 1.0), (2.5, 1.0), (2.6, 0.0)])
    def test_one_looks_over_a_cone_but_not_over_a_container(self, side: float, share: float) -> None:
        assert shares((Kind.STATIC, 5.0, 0.0, 0.0, side, side), (Kind.VEHICLE, 20.0, 0.0, 0.0, 4.0, 2.0))[1] == share

    @pytest.mark.parametrize("kind", [Kind.VEHICLE, Kind.STATIC])
    def test_vehicles_and_props_hide(self, kind: Kind) -> None:
        assert shares((kind, 10.0, 0.0, 0.0, 3.0, 3.0), (Kind.PEDESTRIAN, 20.0, 0.0, 0.0, 1.0, 1.0)).tolist() == [
            1.0,
            0.0,
        ]

    def test_a_building_hides(self) -> None:
        assert shares((Kind.VEHICLE, 30.0, 0.0, 0.0, 4.0, 2.0), houses=(house(15.0, 0.0),)).tolist() == [0.0]

    def test_range_counts_to_the_nearest_point(self) -> None:
        car = (Kind.VEHICLE, 50.0, 0.0, 0.0, 4.0, 2.0)
        assert shares(car, reach=48.0).tolist() == [1.0]
        assert shares(car, reach=47.9).tolist() == [0.0]

    def test_the_carrier_is_neither_seen_nor_in_the_way(self) -> None:
        me, other = (Kind.VEHICLE, 0.0, 0.0, 0.0, 5.0, 2.0), (Kind.VEHICLE, 20.0, 0.0, 0.0, 4.0, 2.0)
        assert shares(me, other, eye=SensorPose(0.0, 0.0, 0.0, 0)).tolist() == [0.0, 1.0]

    def test_inside_of_another_box_or_a_building(self) -> None:
        """What is around the eye is seen and hides nothing."""
        around, other = (Kind.VEHICLE, 0.5, 0.0, 0.3, 5.0, 2.0), (Kind.VEHICLE, 20.0, 0.0, 0.0, 4.0, 2.0)
        assert shares(around, other, houses=(house(0.0, 0.0),)).tolist() == [1.0, 1.0]
        assert (
            SightView(HERE, scene(around), BuildingEdges(town(house(0.0, 0.0))), 50.0).free_sight(8).tolist()
            == [50.0] * 8
        )

    def test_eye_on_an_edge(self) -> None:
        assert np.isfinite(
            shares((Kind.VEHICLE, 2.5, 0.0, 0.0, 5.0, 2.0), (Kind.VEHICLE, 9.0, 0.0, 0.0, 4.0, 2.0))
        ).all()

    def test_an_empty_scene_has_no_shares_and_full_sight(self) -> None:
        assert shares().tolist() == []
        assert SightView(HERE, scene(), BuildingEdges(town()), 50.0).free_sight(4).tolist() == [50.0] * 4

    def test_free_sight_counts_counter_clockwise_from_straight_ahead(self) -> None:
        eye = SensorPose(0.0, 0.0, math.pi / 2, None)
        left = (Kind.VEHICLE, -20.0, 0.0, 0.0, 4.0, 2.0)
        assert SightView(eye, scene(left), BuildingEdges(town(house(0.0, 30.0))), 50.0).free_sight(4) == pytest.approx(
            [25.0, 18.0, 50.0, 50.0]
        )

    def test_seen_rows(self) -> None:
        boxes = scene((Kind.VEHICLE, 20.0, 0.0, 0.0, 4.0, 2.0), (Kind.STATIC, 10.0, 5.0, 0.0, 1.0, 10.0))
        walls = BuildingEdges(town(house(-20.0, 0.0)))
        assert SightView(HERE, boxes, walls, 100.0).visible_rows(0.6).tolist() == [False, True]
        assert SightView(HERE, boxes, walls, 100.0).visible_rows(0.4).tolist() == [True, True]
        assert SightView(HERE, boxes, walls, 15.0).visible_rows(0.0).tolist() == [False, True]


class TestProperties:
    @settings(max_examples=examples(15, 60), deadline=None)
    @given(boxes=boxes_around(8), houses=HOUSES, gone=st.integers(0, 7))
    def test_taking_something_away_hides_nothing(
        self, boxes: list[Box], houses: list[list[tuple[float, float]]], gone: int
    ) -> None:
        assume(gone < len(boxes))
        before = np.delete(shares(*boxes, houses=tuple(houses)), gone)
        after = shares(*boxes[:gone], *boxes[gone + 1 :], houses=tuple(houses))
        assert (after >= before - 1e-6).all()

    @settings(max_examples=examples(15, 60), deadline=None)
    @given(
        boxes=boxes_around(8), turn=st.floats(-7.0, 7.0), shift=st.tuples(st.floats(-500, 500), st.floats(-500, 500))
    )
    def test_rotation_and_translation(self, boxes: list[Box], turn: float, shift: tuple[float, float]) -> None:
        cos, sin = math.cos(turn), math.sin(turn)
        moved = [
            (kind, cos * x - sin * y + shift[0], sin * x + cos * y + shift[1], yaw + turn, length, width)
            for kind, x, y, yaw, length, width in boxes
        ]
        assert shares(*moved, eye=SensorPose(*shift, turn, None)) == pytest.approx(shares(*boxes), abs=1e-5)

    @settings(max_examples=examples(15, 60), deadline=None)
    @given(boxes=boxes_around(8), order=st.randoms(use_true_random=False))
    def test_order_does_not_matter(self, boxes: list[Box], order: "np.random.Generator") -> None:
        rows = list(range(len(boxes)))
        order.shuffle(rows)
        assert shares(*(boxes[i] for i in rows)).tolist() == pytest.approx(shares(*boxes)[rows].tolist(), abs=1e-9)

    @settings(max_examples=examples(12, 40), deadline=None)
    @given(boxes=boxes_around(8))
    def test_mirror_image(self, boxes: list[Box]) -> None:
        mirrored = [(kind, x, -y, -yaw, length, width) for kind, x, y, yaw, length, width in boxes]
        assert shares(*mirrored) == pytest.approx(shares(*boxes), abs=1e-6)


ANY = st.one_of(st.floats(allow_nan=True), st.sampled_from((0.0, -0.0, 1.0, math.pi, 1e200, math.inf)))
GRID = st.integers(-12, 12).map(float)
"""Places whose boxes touch, and whose corners lie in one line with the eye."""


class TestTwins:
    """The compiled functions against the Python text."""

    @staticmethod
    def compare(boxes: Objects, eye: SensorPose, walls: BuildingEdges, reach: float) -> None:
        compare_twins("sensing_visibility_measure_distances", boxes, eye)
        compare_twins("sensing_visibility_compute_visible_fractions", boxes, eye, reach, walls)
        for sectors in (1, 7, 72):
            compare_twins("sensing_visibility_measure_free_sight", boxes, eye, reach, walls, sectors)

    @settings(max_examples=examples(30, 300), deadline=None)
    @given(
        boxes=boxes_around(12),
        houses=HOUSES,
        eye=st.builds(SensorPose, GRID, GRID, st.floats(-9.0, 9.0), st.sampled_from((None, 0, 3))),
        reach=st.sampled_from((0.5, 20.0, 60.0, math.nan)),
    )
    def test_any_scene(
        self, boxes: list[Box], houses: list[list[tuple[float, float]]], eye: SensorPose, reach: float
    ) -> None:
        self.compare(scene(*boxes).boxes, eye, BuildingEdges(town(*houses)), reach)

    @settings(max_examples=examples(30, 300), deadline=None)
    @given(
        boxes=st.lists(
            st.tuples(st.sampled_from(list(Kind)), GRID, GRID, st.sampled_from((0.0, math.pi / 2, 1.0)), GRID, GRID),
            max_size=8,
        ),
        houses=st.lists(st.tuples(GRID, GRID).map(lambda at: house(*at)), max_size=2),
    )
    def test_ties(self, boxes: list[Box], houses: list[list[tuple[float, float]]]) -> None:
        self.compare(scene(*boxes, *boxes[:2]).boxes, HERE, BuildingEdges(town(*houses)), 9.0)

    @settings(max_examples=examples(30, 300), deadline=None)
    @given(
        boxes=st.lists(st.tuples(st.just(Kind.VEHICLE), ANY, ANY, ANY, ANY, ANY), max_size=4),
        eye=st.builds(SensorPose, ANY, ANY, ANY, st.none()),
        reach=ANY,
    )
    def test_numbers_that_mean_nothing(self, boxes: list[Box], eye: SensorPose, reach: float) -> None:
        self.compare(scene(*boxes, (Kind.VEHICLE, 20.0, 0.0, 0.0, 4.0, 2.0)).boxes, eye, BuildingEdges(town()), reach)

    def test_columns_of_different_lengths_are_refused(self) -> None:
        boxes = scene((Kind.VEHICLE, 20.0, 0.0, 0.0, 4.0, 2.0)).boxes
        self.compare(replace(boxes, width=np.ones(2)), HERE, BuildingEdges(town()), 50.0)

    def test_walls_beyond_their_array_are_refused(self) -> None:
        walls = BuildingEdges(town(house(10.0, 0.0)))
        walls.ends = np.array([900])
        with pytest.raises(ValueError, match="expected walls"):
            SightView(HERE, scene(), walls, 50.0).free_sight(4)
