"""Random and hand-made V2X messages: shared by tests of their encoding. No tests in here."""

import string

import numpy as np
from hypothesis import strategies as st

from mdrive_sumo.contract import Objects
from mdrive_sumo.v2x.messages import (
    Cam,
    Cpm,
    Denm,
    Direction,
    EventCause,
    Feature,
    FeatureGrid,
    Intention,
    Mcm,
    ReferencePose,
    Termination,
    format_track_name,
)

HEADER, OBJECT = 18, 21


def within(most: float) -> st.SearchStrategy[float]:
    return st.floats(-most, most)


poses = st.builds(
    ReferencePose,
    within(20_000.0),
    within(20_000.0),
    within(10.0),
    st.integers(0, 2**32 - 1),
    st.floats(0.0, 600.0),
    st.floats(0.0, 0.4),
)
names = st.dictionaries(st.text(string.ascii_letters + "äß_-", min_size=1, max_size=20), st.booleans(), max_size=4)


@st.composite
def cams(draw: st.DrawFn) -> Cam:
    pose, seed = draw(poses), draw(st.none() | st.integers(0, 999))
    rng = np.random.default_rng(seed)
    place = np.array((pose.x, pose.y))
    path = None if seed is None else place + rng.uniform(-200, 200, (draw(st.integers(0, 40)), 2))
    return Cam(
        pose,
        draw(within(90)),
        draw(within(90)),
        draw(within(9)),
        draw(st.floats(0, 30)),
        draw(st.floats(0, 5)),
        draw(st.floats(0, 2.5)),
        path,
    )


@st.composite
def denms(draw: st.DrawFn) -> Denm:
    pose = draw(poses)
    return Denm(
        pose,
        sequence=draw(st.integers(0, 2**16 - 1)),
        cause=draw(st.sampled_from(EventCause)),
        sub_cause=draw(st.integers(0, 255)),
        x=pose.x + draw(within(200.0)),
        y=pose.y + draw(within(200.0)),
        detection_tick=draw(st.integers(0, 2**32 - 1)),
        validity_s=draw(st.integers(0, 65535)) / 10,
        speed=draw(within(90)),
        length=draw(st.floats(0, 30)),
        width=draw(st.floats(0, 5)),
        termination=draw(st.sampled_from(Termination)),
    )


def objects_around(pose: ReferencePose, count: int, sectors: int, range_m: float, seed: int) -> Objects:
    rng = np.random.default_rng(seed)
    return Objects(
        ids=tuple(format_track_name(int(number)) for number in rng.integers(0, 2**32, count)),
        kind=rng.integers(0, 4, count).astype(np.uint8),
        x=pose.x + rng.uniform(-200, 200, count),
        y=pose.y + rng.uniform(-200, 200, count),
        yaw=rng.uniform(-4, 4, count),
        speed=rng.uniform(-20, 60, count),
        length=rng.uniform(0, 20, count),
        width=rng.uniform(0, 4, count),
        free_m=rng.uniform(0, range_m, sectors),
    )


@st.composite
def cpms(draw: st.DrawFn) -> Cpm:
    pose, range_m = draw(poses), draw(st.integers(1, 2000)) / 10
    count, sectors = draw(st.integers(0, 12)), draw(st.integers(0, 80))
    objects = objects_around(pose, count, sectors, range_m, draw(st.integers(0, 999)))
    sigmas = np.random.default_rng(count).uniform(0, (2.5, 0.4, 2.5), (count, 3))
    return Cpm(pose, range_m, objects, np.arange(count, dtype=np.uint8), draw(st.booleans()), sigmas)


@st.composite
def mcms(draw: st.DrawFn) -> Mcm:
    pose = draw(poses)
    rng = np.random.default_rng(draw(st.integers(0, 999)))
    here = np.array((pose.x, pose.y))
    planned, desired = (here + rng.uniform(-200, 200, (draw(st.integers(0, 25)), 2)) for _ in range(2))
    return Mcm(
        pose,
        speed=draw(within(90)),
        intention=draw(st.sampled_from(Intention)),
        direction=draw(st.sampled_from(Direction)),
        interval_s=draw(st.integers(1, 255)) / 100,
        planned=planned,
        desired=desired,
        requests={name: Intention(int(yes)) for name, yes in draw(names).items()},
        answers=draw(names),
        group=tuple(sorted(draw(names))),
        until_tick=draw(st.integers(0, 2**32 - 1)),
    )


grids = st.builds(
    lambda name, version, side, tiles, channels, cell_mm: FeatureGrid(
        name, version, cell_mm / 1000, side * tiles[0], side * tiles[1], channels, side
    ),
    st.text("abz09_-", min_size=1, max_size=16),
    st.integers(0, 65535),
    st.integers(1, 5),
    st.tuples(st.integers(1, 4), st.integers(1, 4)),
    st.integers(1, 6),
    st.integers(1, 4000),
)


@st.composite
def features(draw: st.DrawFn) -> Feature:
    """Of any sparsity; some are larger than a packet would be without their few values."""
    grid, rng = draw(grids), np.random.default_rng(draw(st.integers(0, 999)))
    count = draw(st.integers(0, grid.tile_rows * grid.tile_columns))
    most, share = draw(st.sampled_from((1, 7, 255))), draw(st.floats(0.0, 1.0))
    places = np.flatnonzero(rng.random(count * grid.tile_values) < share)[:600]
    return Feature(
        draw(poses),
        grid,
        rng.uniform(0, 9, grid.channels).astype(np.float16).astype(np.float64),
        rng.permutation(grid.tile_rows * grid.tile_columns)[:count],
        rng.integers(0, 256, count) / 255,
        places,
        rng.integers(1, most + 1, len(places)) * rng.choice((1, draw(st.sampled_from((-1, 1)))), len(places)),
    )


texts = st.text(max_size=200)
contents = st.one_of(cams(), cpms(), mcms(), denms(), features(), texts)


PLACE = ReferencePose(100.0, 50.0, 0.3, 9)


def mcm_with(**parts: object) -> Mcm:
    values: dict[str, object] = {"speed": 1.0, "interval_s": 0.2, "planned": np.zeros((0, 2))}
    return Mcm(PLACE, intention=Intention.KEEP, direction=Direction.LEFT, **(values | parts))


def cpm_with(count: int = 1, sectors: int = 0, **parts: object) -> Cpm:
    values: dict[str, object] = {name: np.zeros(count) for name in ("yaw", "speed", "length", "width")}
    values |= {"ids": (format_track_name(1),) * count, "kind": np.zeros(count, np.uint8), "free_m": np.zeros(sectors)}
    values |= {"x": np.full(count, PLACE.x), "y": np.full(count, PLACE.y)}
    return Cpm(PLACE, 50.0, Objects(**(values | parts)), np.zeros(count, np.uint8))
