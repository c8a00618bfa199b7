"""Times and numbers in a log that ask for more memory than there is: one sentence, before anything is allocated."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing import argoverse2_samples as argoverse2
from testing.commonroad_samples import LANE, MOVES, Write, format_obstacle
from testing.interaction_samples import build_street, write_table
from testing.v2xpnp_samples import frame, log

from mdrive_sumo.core.errors import InputError
from real2sim.pipeline.log_source import LogSource, read_log
from real2sim.readers.argoverse2 import read_argoverse2
from real2sim.readers.commonroad import read_commonroad
from real2sim.readers.input_checks import (
    MAX_FRAMES,
    MAX_ROWS,
    check_frame_count,
    describe_value,
    find_gap,
    parse_points,
)
from real2sim.readers.interaction import read_interaction
from real2sim.readers.v2xpnp import read_v2xpnp


@pytest.mark.parametrize("last", ["12884901900", "1e300", "-7e16"])
def test_interaction_tables_over_centuries(last: str, tmp_path: Path) -> None:
    build_street().write(tmp_path / "map.osm")
    tracks = write_table(
        tmp_path / "vehicle_tracks_000.csv", "1,1,100,car,1,2,10,0,0,4,2", f"1,2,{last},car,1,2,10,0,0,4,2"
    )
    with pytest.raises(InputError, match=r"vehicle_tracks_000\.csv: timestamp_ms: expected times within 36000 frames"):
        read_interaction(tracks, tmp_path / "map.osm")


@pytest.mark.parametrize("last", [10**11, 10**40])
def test_commonroad_scenarios_over_centuries(last: int, write: Write) -> None:
    path = write(LANE, format_obstacle(7, MOVES.replace("<exact>6<", f"<exact>{last}<")))
    with pytest.raises(InputError, match=r"scenario\.xml: time: expected times within 36000 frames, found 1e\+"):
        read_commonroad(path)


@pytest.mark.parametrize(
    ("time_ns", "message"),
    [
        (argoverse2.START_NS * 4, r"expected times within 36000 frames, found 9\.\d+e\+09 from first to last"),
        (2**63 - 1, "expected times within 126 years of 1970, found others"),
        (-(2**63), "expected times within 126 years of 1970, found others"),
    ],
)
def test_argoverse2_sweeps_over_years(time_ns: int, message: str, tmp_path: Path) -> None:
    boxes = argoverse2.change_value(argoverse2.CAR, "timestamp_ns", time_ns)
    with pytest.raises(InputError, match=f"timestamp_ns: {message}"):
        read_argoverse2(argoverse2.log(tmp_path, boxes))


def test_argoverse2_poses_over_years(tmp_path: Path) -> None:
    poses = argoverse2.change_value(argoverse2.pose_rows(), "timestamp_ns", 2**63 - 1)
    with pytest.raises(
        InputError, match=r"city_SE3_egovehicle\.feather: timestamp_ns: expected times within 126 years"
    ):
        read_argoverse2(argoverse2.log(tmp_path, poses=poses))


def test_v2xpnp_frames_and_agents_with_huge_numbers(tmp_path: Path) -> None:
    folder = log(tmp_path / "a", {"1": [frame()]})
    (folder / "1" / "99999999999999999999.yaml").write_text(frame())
    with pytest.raises(InputError, match=r"found none between 000000\.yaml and 99999999999999999999\.yaml"):
        read_v2xpnp(folder, ())
    (folder / "1" / "99999999999999999999.yaml").unlink()
    (folder / "77777777777777777777").mkdir()
    with pytest.raises(InputError, match=r"expected agent folders without holes, .* no folder 2$"):
        read_v2xpnp(folder, ())


def test_a_log_of_too_many_rows() -> None:
    assert check_frame_count("x", MAX_FRAMES, MAX_ROWS // MAX_FRAMES) == MAX_FRAMES
    with pytest.raises(InputError, match=r"x: expected at most 20000000 rows of frames and tracks, found 36000 frames"):
        check_frame_count("x", MAX_FRAMES, MAX_ROWS // MAX_FRAMES + 1)
    for count in (float("inf"), float("nan"), MAX_FRAMES + 1, 10**400):
        with pytest.raises(InputError, match="x: expected times within 36000 frames"):
            check_frame_count("x", count)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([(0, 0), (1e9, 0)], "expected coordinates within 1e\\+08 m, found \\[1000000000.0, 0.0\\]"),
        ([(0, 0), (9e7, 0)], "expected a line of at most 100000 m, found 9e\\+07 m"),
    ],
)
def test_lines_that_are_longer_than_any_road(points: list[tuple[float, float]], message: str) -> None:
    with pytest.raises(InputError, match=f"x: {message}"):
        parse_points("x", points)


@pytest.mark.parametrize(("row", "name"), [("1e300,2,10,0,0,4,2", "x"), ("1,2,10,0,0,4,999", "width")])
def test_positions_and_sizes_of_no_place_on_earth(row: str, name: str, tmp_path: Path) -> None:
    build_street().write(tmp_path / "map.osm")
    tracks = write_table(tmp_path / "vehicle_tracks_000.csv", "1,1,100,car,1,2,10,0,0,4,2", f"1,2,200,car,{row}")
    with pytest.raises(
        InputError, match=rf"vehicle_tracks_000\.csv: track 1: {name}: expected at most \S+ m, found more"
    ):
        read_log(LogSource("interaction", tracks))


def test_a_header_of_several_lines_is_told_in_one(tmp_path: Path) -> None:
    path = write_table(tmp_path / "vehicle_tracks_000.csv", header='track_id,"a\nb"')
    with pytest.raises(InputError, match=r"expected the column timestamp_ms, found track_id, a b$"):
        read_interaction(path, tmp_path / "map.osm")


@given(st.sets(st.integers(-20, 20), min_size=1))
def test_the_first_gap(numbers: set[int]) -> None:
    missing = sorted(set(range(min(numbers), max(numbers))) - numbers)
    assert find_gap(numbers) == (missing[0] if missing else None)


def test_nested_lists_that_share_their_parts_are_described_at_once() -> None:
    nested: list[object] = [0]
    for _ in range(64):
        nested = [nested] * 4
    assert describe_value(nested) == "[[[[...], [...], [...], [...]], [[...], [...], [...], [...]]"
