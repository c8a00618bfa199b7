"""The objects sensor, its error profiles against published figures, and the weather's factors."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from testing.worlds import straight_road

from mdrive_sumo.contract import Objects, SensorSpec
from mdrive_sumo.contract.detector_profiles import IDEAL, PROFILES, PUBLISHED
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float, box_corners
from mdrive_sumo.core.state import Kind
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.roads.network_file import Building
from mdrive_sumo.scenario.weather import WEATHERS, WeatherName
from mdrive_sumo.sensing.detection_noise import EPOCH_TICKS
from mdrive_sumo.sensing.objects_sensor import ObjectsSensor
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose, SensorSetup, derive_track_name
from tools import detector_calibration
from tools.detector_calibration import HIDDEN_FROM_ONE, fit_profile, measure_average_precision

pytestmark = pytest.mark.slow

HERE = SensorPose(0.0, 0.0, 0.0, 0)
Place = tuple[float, float]


def cars(*places: Place, names: tuple[str, ...] = (), tick: int = 0) -> SensingFrame:
    """The carrier at the origin and cars at the places, that head north at 5 m/s."""
    count = len(places) + 1
    x, y = np.array([(0.0, 0.0), *places]).T
    ids = ("me", *(names or tuple(f"c{i}" for i in range(len(places)))))
    size = np.full(count, 4.6), np.full(count, 1.9)
    kind = np.full(count, Kind.VEHICLE, dtype=np.uint8)
    return SensingFrame(tick, Objects(ids, kind, x, y, np.full(count, math.pi / 2), np.full(count, 5.0), *size), {})


def sensor(
    range_m: float = 100.0,
    weather: WeatherName = "default",
    roads: RoadMap | None = None,
    seed: int = 1,
    **options: float | str | bool,
) -> ObjectsSensor:
    fitting = SensorSetup("me", seed, roads or straight_road(), WEATHERS[weather], None)
    return ObjectsSensor(SensorSpec("objects", range_m=range_m, options=options), fitting)


def name(true_id: str) -> str:
    return derive_track_name("me", true_id)


def house(x: float, y: float, size: float) -> RoadMap:
    outline = tuple((float(a), float(b)) for a, b in box_corners(x, y, 0.0, size, size))
    return replace(straight_road(), buildings=(Building(id="h", polygon=outline),))


class TestIdeal:
    def test_exact_and_nearest_first(self) -> None:
        seen = sensor().sense(cars((40.0, 0.0), (-20.0, 3.0), (0.0, 30.0)), HERE)
        assert seen.ids == (name("c1"), name("c2"), name("c0"))
        assert seen.x.tolist() == [-20.0, 0.0, 40.0]
        assert seen.y.tolist() == [3.0, 30.0, 0.0]
        assert seen.speed.tolist() == [5.0] * 3
        assert seen.length.tolist() == [4.6] * 3
        assert seen.free_m.tolist() == []

    def test_hidden_behind_a_car_and_behind_a_building(self) -> None:
        assert sensor().sense(cars((20.0, 0.0), (40.0, 0.0)), HERE).ids == (name("c0"),)
        assert sensor(roads=house(20.0, 0.0, 8.0)).sense(cars((40.0, 0.0), (0.0, 40.0)), HERE).ids == (name("c1"),)

    def test_a_tenth_is_enough(self) -> None:
        """The house ends a little beyond the middle of the car at 40 m."""
        scene = cars((40.0, 0.0))
        assert len(sensor(roads=house(20.0, -4.1, 8.0)).sense(scene, HERE).ids) == 1
        assert len(sensor(roads=house(20.0, -4.1, 8.0), min_visible=0.9).sense(scene, HERE).ids) == 0
        assert len(sensor(roads=house(20.0, -3.1, 8.0)).sense(scene, HERE).ids) == 0
        assert len(sensor(roads=house(20.0, -3.1, 8.0), min_visible=0.0).sense(scene, HERE).ids) == 1

    @pytest.mark.parametrize(
        ("weather", "reach"), [("default", 50.0), ("cloudy", 50.0), ("rain", 40.0), ("night", 35.0)]
    )
    def test_range_and_weather(self, weather: WeatherName, reach: float) -> None:
        inside, outside = cars((reach + 0.9, 0.0)), cars((reach + 1.0, 0.0))  # the near side is 0.95 m nearer
        assert len(sensor(50.0, weather).sense(inside, HERE).ids) == 1
        assert len(sensor(50.0, weather).sense(outside, HERE).ids) == 0

    def test_field_of_view_turns_with_the_car(self) -> None:
        scene = cars((20.0, 0.0), (-20.0, 0.0), (0.0, 20.0), (0.0, -20.0))
        assert sensor(fov_deg=90.0).sense(scene, HERE).ids == (name("c0"),)
        assert sensor(fov_deg=90.0, yaw_deg=90.0).sense(scene, HERE).ids == (name("c2"),)
        assert sensor(fov_deg=90.0, yaw_deg=90.0).sense(scene, replace(HERE, yaw=math.pi / 2)).ids == (name("c1"),)

    def test_free_sight(self) -> None:
        scene = cars((20.0, 0.0))
        seen = sensor(free_space=True).sense(scene, HERE)
        assert len(seen.free_m) == 72
        assert seen.free_m[0] == pytest.approx(20.0 - 1.9 / 2)
        assert seen.free_m[36] == pytest.approx(100.0)
        assert len(sensor(free_space=8).sense(scene, HERE).free_m) == 8
        assert len(sensor(free_space=False).sense(scene, HERE).free_m) == 0

    def test_a_roadside_unit_detects_all_road_users(self) -> None:
        assert len(sensor().sense(cars((20.0, 0.0)), SensorPose(0.0, 20.0, 0.0, None)).ids) == 2

    @pytest.mark.parametrize(
        "options",
        [
            {"profile": "perfect"},
            {"profile": 3.0},
            {"fov_deg": 0.0},
            {"fov_deg": math.nan},
            {"yaw_deg": "left"},
            {"free_space": -1.0},
            {"free_space": "yes"},
            {"min_visible": 1.1},
            {"colour": "red"},
        ],
    )
    def test_bad_options(self, options: dict[str, float | str | bool]) -> None:
        with pytest.raises(InputError):
            sensor(**options)

    @pytest.mark.parametrize("range_m", [0.0, -1.0, math.nan, math.inf])
    def test_bad_range(self, range_m: float) -> None:
        with pytest.raises(InputError):
            sensor(range_m)


RING: tuple[Place, ...] = tuple((40 * math.cos(a), 40 * math.sin(a)) for a in np.arange(12) * math.pi / 6)
"""Twelve cars around the carrier, none in front of another."""


def seen_at(device: ObjectsSensor, tick: int, places: tuple[Place, ...] = RING) -> dict[str, Float]:
    """Name -> x, y, yaw, speed, length of what the sensor tells in that tick."""
    seen = device.sense(cars(*places, tick=tick), HERE)
    table = np.column_stack((seen.x, seen.y, seen.yaw, seen.speed, seen.length))
    return dict(zip(seen.ids, table, strict=True))


def instant(profile: str, monkeypatch: pytest.MonkeyPatch, **changes: float) -> None:
    """The profile without latency, for tests that ask in any order."""
    changed = {**PROFILES, profile: replace(PROFILES[profile], latency_ticks=0, **changes)}
    monkeypatch.setattr("mdrive_sumo.sensing.objects_sensor.PROFILES", changed)


class TestFlaws:
    def test_depend_on_seed_tick_and_id_only(self, monkeypatch: pytest.MonkeyPatch) -> None:
        instant("attfuse", monkeypatch)
        forth, back = sensor(profile="attfuse"), sensor(profile="attfuse")
        ticks = range(0, 60, 7)
        first = [seen_at(forth, tick) for tick in ticks]
        second = [seen_at(back, tick) for tick in reversed(ticks)][::-1]
        for one, other in zip(first, second, strict=True):
            assert one.keys() == other.keys()
            assert all((one[key] == other[key]).all() for key in one)
        assert any((seen_at(sensor(profile="attfuse", seed=2), 0).get(k, v) != v).any() for k, v in first[0].items())

    def test_the_order_of_things_does_not_matter(self, monkeypatch: pytest.MonkeyPatch) -> None:
        instant("fcooper", monkeypatch)
        device, names = sensor(profile="fcooper"), tuple(f"c{i}" for i in range(12))
        one = device.sense(cars(*RING, names=names), HERE)
        other = device.sense(cars(*RING[::-1], names=names[::-1]), HERE)
        assert one.ids == other.ids
        assert one.x.tolist() == other.x.tolist()

    def test_a_miss_lasts_half_a_second(self, monkeypatch: pytest.MonkeyPatch) -> None:
        instant("attfuse", monkeypatch, recall=0.5, false_positives=0.0)
        device, names = sensor(profile="attfuse"), [name(f"c{i}") for i in range(12)]
        told = [seen_at(device, tick) for tick in range(200)]
        seen = np.array([[one in now for one in names] for now in told])
        assert seen.mean() == pytest.approx(0.5 * (1 - 0.1 * 0.4), abs=0.06)
        changes = np.flatnonzero(np.diff(seen[:, 0].astype(int)))
        assert len(changes) > 3
        assert set(np.diff(changes) % EPOCH_TICKS) == {0}
        assert len({tuple(np.flatnonzero(np.diff(column.astype(int)))[:1] % EPOCH_TICKS) for column in seen.T}) > 1

    def test_errors_have_their_sigma_and_change_smoothly(self, monkeypatch: pytest.MonkeyPatch) -> None:
        instant("attfuse", monkeypatch, recall=1.0, recall_far=1.0, false_positives=0.0)
        profile, device = PROFILES["attfuse"], sensor(profile="attfuse")
        told = [seen_at(device, tick) for tick in range(0, 1500, 3)]
        errors = np.array([[one[name(f"c{i}")][:2] - RING[i] for i in range(12)] for one in told])
        sigma = profile.spread * (1 + 40 / profile.spread_doubles_m)
        assert errors.std(axis=(0, 1)) == pytest.approx([sigma, sigma], rel=0.1)
        assert np.abs(errors.mean((0, 1))).max() < 0.1 * sigma
        assert np.diff(errors, axis=0).std() < 0.8 * sigma  # white noise has sqrt(2) sigma
        yaw = np.array([one[name(f"c{i}")][2] for one in told for i in range(12)]) - math.pi / 2
        assert yaw.std() == pytest.approx(profile.yaw_sigma, rel=0.1)

    def test_false_positives(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """As many as the profile says, under names like any other, where sight is free, standing still in the world."""
        instant("cobevt", monkeypatch, false_positives=3.0)
        device = sensor(profile="cobevt")
        told = [seen_at(device, tick, ()) for tick in range(0, 4000, 10)]
        assert np.mean([len(one) for one in told]) == pytest.approx(3.0, rel=0.1)
        assert all(key.startswith(name("c0")[:1]) and len(key) == len(name("c0")) for one in told for key in one)
        assert max(math.hypot(row[0], row[1]) for one in told for row in one.values()) <= 100.0
        walled = sensor(profile="cobevt", roads=house(110.0, 0.0, 200.0))
        assert all(row[0] < 11.0 for tick in range(0, 400, 10) for row in seen_at(walled, tick, ()).values())

    def test_a_false_positive_stands_still_when_the_car_moves(self, monkeypatch: pytest.MonkeyPatch) -> None:
        instant("cobevt", monkeypatch, false_positives=5.0)
        device, common = sensor(profile="cobevt"), 0
        for tick in range(0, 200, 10):
            one, other = (device.sense(cars(tick=tick), replace(HERE, x=x)) for x in (0.0, 3.0))
            for key in set(one.ids) & set(other.ids):
                common += 1
                assert one.x[one.ids.index(key)] == other.x[other.ids.index(key)]
        assert common > 20

    def test_latency(self) -> None:
        """What is told in tick t was so at t - 2; nothing is known before."""
        late = sensor(profile="attfuse", free_space=8)
        told = [late.sense(cars((20.0 + tick, 0.0), tick=tick), HERE) for tick in range(40)]
        assert PROFILES["attfuse"].latency_ticks == 2
        assert told[0].ids == told[1].ids == ()
        assert [one.free_m.tolist() for one in told[:2]] == [[0.0] * 8] * 2
        assert told[2].free_m[0] == pytest.approx(20.0 - 1.9 / 2)
        x = {t: float(one.x[one.ids.index(name("c0"))]) for t, one in enumerate(told) if name("c0") in one.ids}
        assert len(x) > 15
        assert all(seen == pytest.approx(18.0 + tick, abs=1.0) for tick, seen in x.items())

    def test_latency_counts_ticks_however_seldom_one_looks(self) -> None:
        late = sensor(profile="attfuse")
        told = {t: late.sense(cars((20.0 + t, 0.0), tick=t), HERE) for t in range(0, 80, 4)}
        x = {t: float(one.x[one.ids.index(name("c0"))]) for t, one in told.items() if name("c0") in one.ids}
        assert len(x) > 5
        assert all(seen == pytest.approx(16.0 + tick, abs=1.0) for tick, seen in x.items())

    @settings(max_examples=30, deadline=None)
    @given(
        distance=st.floats(0.0, 200.0),
        visible=st.floats(0.0, 1.0),
        more=st.floats(0.0, 1.0),
        further=st.floats(0.0, 50.0),
    )
    def test_recall_falls_with_distance_and_rises_with_visibility(
        self, distance: float, visible: float, more: float, further: float
    ) -> None:
        for profile in PROFILES.values():
            distances, shares = np.array([distance, distance + further]), np.array([visible, max(visible, more)])
            near, far = profile.recall_at(distances, np.full(2, visible))
            less, plain = profile.recall_at(np.full(2, distance), shares)
            assert 0.0 <= far <= near <= 1.0
            assert 0.0 <= less <= plain <= 1.0


class TestPublishedFigures:
    """Seeds 1 and 2 were not used in the fit, which is of seed 0."""

    @pytest.mark.parametrize(
        ("profile", "seeds"),
        [("cobevt", (1,)), *(pytest.param(p, (0, 1, 2), marks=pytest.mark.full) for p in PUBLISHED)],
    )
    def test_surrogates_reach_them(self, profile: str, seeds: tuple[int, ...]) -> None:
        hidden = HIDDEN_FROM_ONE if profile == "lidar-single" else 0.0
        for seed in seeds:
            assert measure_average_precision(PROFILES[profile], 0.5, seed, hidden) == pytest.approx(
                PUBLISHED[profile].ap50, abs=0.02
            )
            assert measure_average_precision(PROFILES[profile], 0.7, seed, hidden) == pytest.approx(
                PUBLISHED[profile].ap70, abs=0.02
            )

    def test_the_ideal_detector_misses_nothing(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(detector_calibration, "FRAMES", 100)
        assert measure_average_precision(PROFILES[IDEAL], 0.7, 3) == 1.0

    def test_every_surrogate_has_its_source(self) -> None:
        assert PUBLISHED.keys() == PROFILES.keys() - {IDEAL}

    @pytest.mark.full
    def test_the_fit_is_reproducible(self) -> None:
        again = fit_profile(replace(PROFILES["fcooper"], recall=0.9, spread=0.2), PUBLISHED["fcooper"], 0)
        assert (again.recall, again.spread) == (PROFILES["fcooper"].recall, PROFILES["fcooper"].spread)


def test_rain_shortens_a_lidar_as_an_optical_link() -> None:
    """1.076 R^0.67 dB/km at R = 35 mm/h, there and back: an echo from 100 m on a clear day comes from 80 m."""
    per_metre = 1.076 * 35**0.67 / 1000 * math.log(10) / 10
    reach = 100.0
    for _ in range(100):
        reach = 100.0 * math.exp(-per_metre * reach)  # r^2 exp(2 a r) = (100 m)^2
    assert reach / 100.0 == pytest.approx(WEATHERS["rain"].lidar_range, abs=0.01)
