"""Unusable logs: one sentence, exit code 2, and nothing is left behind."""

import math
import os
import pickle
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from testing.convert_command import refused, run
from testing.small_log import road, write_small_log

from real2sim.hd_map import HdMap
from real2sim.pipeline.log_conversion import MAX_LOG_S

pytestmark = pytest.mark.slow


def truncated(log: Path) -> None:
    file = log / "1" / "000020.yaml"
    file.write_text(file.read_text()[: len(file.read_text()) // 2])


def without_agent(log: Path) -> None:
    shutil.rmtree(log / "1")


def with_hole(log: Path) -> None:
    for number in range(7, 28):
        (log / "-1" / f"{number:06d}.yaml").unlink()


def with_nan(log: Path) -> None:
    file = log / "2" / "000003.yaml"
    head, _, rest = file.read_text().partition("lidar_pose:\n- ")
    assert rest
    file.write_text(f"{head}lidar_pose:\n- .nan\n{rest.partition(chr(10))[2]}")


BROKEN: dict[Callable[[Path], None], str] = {
    truncated: "1/000020.yaml",
    without_agent: "no folder 1",
    with_hole: "expected at most 19 missing frames in a row, found none between 000006.yaml and 000028.yaml",
    with_nan: "2/000003.yaml",
}


@pytest.mark.usefixtures("in_process")
def test_every_broken_log_of_a_batch_is_reported_in_a_sentence(small: tuple[Path, Path], tmp_path: Path) -> None:
    for spoil in BROKEN:
        shutil.copytree(small[0], tmp_path / "logs" / spoil.__name__)
        spoil(tmp_path / "logs" / spoil.__name__)
    done = run("v2xpnp", tmp_path / "logs", "--map", small[1], "--out", tmp_path / "out", "--workers", "2")
    assert done.exit_code == 2
    sentences = [line for line in done.stderr.splitlines() if line.startswith("Error: ") and ": expected " in line]
    assert len(sentences) == len(BROKEN)
    for spoil, words in BROKEN.items():
        (sentence,) = [line for line in sentences if f"logs/{spoil.__name__}" in line]
        assert words in sentence
        assert "found" in sentence
    assert [path.name for path in tmp_path.iterdir()] == ["logs"]


@pytest.mark.usefixtures("in_process")
def test_one_unusable_log_does_not_keep_the_others_from_being_converted(
    small: tuple[Path, Path], tmp_path: Path
) -> None:
    shutil.copytree(small[0], tmp_path / "broken")
    truncated(tmp_path / "broken")
    done = run("v2xpnp", tmp_path / "broken", small[0], "--map", small[1], "--out", tmp_path / "out")
    assert done.exit_code == 2
    assert "1 of 1 scenarios meet every target; 1 log unusable" in done.stdout
    assert "Error: " in done.stderr
    assert "broken/1/000020.yaml" in done.stderr
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["networks", "small", "suite.json"]


class Exploit:
    def __init__(self, trace: Path) -> None:
        self.trace = trace

    def __reduce__(self) -> Any:
        return os.system, (f"touch {self.trace}",)


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize("source", ["v2xpnp", "scenarionet"])
def test_a_pickle_of_another_class_is_refused_by_name_and_nothing_runs(
    source: str, small: tuple[Path, Path], tmp_path: Path
) -> None:
    trace, bad = tmp_path / "ran", tmp_path / "bad.pkl"
    bad.write_bytes(pickle.dumps(Exploit(trace)))
    arguments = (small[0], "--map", bad) if source == "v2xpnp" else (bad,)
    sentence = refused(tmp_path, source, *arguments)
    assert "bad.pkl" in sentence
    assert f"{os.name}.system" in sentence
    assert not trace.exists()


@pytest.mark.usefixtures("in_process")
def test_an_empty_map(small: tuple[Path, Path], tmp_path: Path) -> None:
    _, map_ = write_small_log(tmp_path / "log", HdMap())
    sentence = refused(tmp_path, "v2xpnp", small[0], "--map", map_)
    assert "log/map.pkl" in sentence
    assert "lane" in sentence
    assert "found none" in sentence


@pytest.mark.usefixtures("in_process")
def test_a_map_of_another_place_says_how_far(small: tuple[Path, Path], tmp_path: Path) -> None:
    _, map_ = write_small_log(tmp_path / "log", road(y=500.0))
    sentence = refused(tmp_path, "v2xpnp", small[0], "--map", map_)
    assert "median 500 m" in sentence
    assert "map of another place" in sentence


@pytest.mark.usefixtures("in_process")
def test_a_map_of_another_place_for_sources_whose_reader_does_not_look(tmp_path: Path) -> None:
    """INTERACTION: tracks and map are two files that nothing ties together."""
    names = "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width"
    rows = [f"1,{k + 1},{100 * (k + 1)},car,{5000 + k},1000,10,0,0,4.5,1.8" for k in range(40)]
    (tmp_path / "vehicle_tracks_000.csv").write_text("\n".join((names, *rows)) + "\n")
    (tmp_path / "map.osm").write_text(lanelet())
    sentence = refused(tmp_path, "interaction", tmp_path / "vehicle_tracks_000.csv")
    assert "vehicle_tracks_000.csv: expected tracks on the lanes of the map, found 100% of the vehicles'" in sentence
    distance = float(sentence.partition("median ")[2].partition(" m")[0])
    assert distance == pytest.approx(math.hypot(5019 - 100, 1000), rel=0.02)


def lanelet() -> str:
    """One lane, 100 m eastwards along y = 0, in degrees about the origin as INTERACTION has it."""
    degree = 111319.49
    points = [(1, 0.0, 1.75), (2, 100.0, 1.75), (3, 0.0, -1.75), (4, 100.0, -1.75)]
    nodes = "".join(f'<node id="{i}" lat="{y / degree:.9f}" lon="{x / degree:.9f}"/>' for i, x, y in points)
    ways = "".join(
        f'<way id="{i}"><nd ref="{a}"/><nd ref="{b}"/><tag k="type" v="line_thin"/></way>'
        for i, a, b in ((11, 1, 2), (12, 3, 4))
    )
    lane = (
        '<relation id="21"><member type="way" ref="11" role="left"/><member type="way" ref="12" role="right"/>'
        '<tag k="type" v="lanelet"/><tag k="subtype" v="road"/><tag k="one_way" v="yes"/></relation>'
    )
    return f'<?xml version="1.0"?><osm version="0.6">{nodes}{ways}{lane}</osm>'


@pytest.mark.usefixtures("in_process")
def test_an_unsupported_commonroad_version(tmp_path: Path) -> None:
    path = tmp_path / "old.xml"
    path.write_text('<commonRoad commonRoadVersion="2017a" timeStepSize="0.1"><lanelet id="1"/></commonRoad>')
    sentence = refused(tmp_path, "commonroad", path)
    assert "old.xml: commonRoadVersion: expected 2018b or 2020a, found '2017a'" in sentence


@pytest.mark.usefixtures("in_process")
def test_a_long_log_proposes_a_window(tmp_path: Path) -> None:
    names = "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width"
    rows = [f"1,{k + 1},{100 * (k + 1)},car,{k / 20:.2f},0,0.5,0,0,4.5,1.8" for k in range(10 * round(MAX_LOG_S) + 2)]
    (tmp_path / "vehicle_tracks_000.csv").write_text("\n".join((names, *rows)) + "\n")
    (tmp_path / "map.osm").write_text(lanelet())
    sentence = refused(tmp_path, "interaction", tmp_path)
    assert "expected at most 60 s, found a log of 60.1 s: choose a part with --window 0,20" in sentence


@pytest.mark.usefixtures("in_process")
def test_a_log_too_short_for_the_checks_is_refused(small: tuple[Path, Path], tmp_path: Path) -> None:
    sentence = refused(tmp_path, "v2xpnp", small[0], "--map", small[1], "--window", "0,0.5")
    assert f"{small[0]}: expected at least 2 s, found 0.5 s" in sentence


@pytest.mark.usefixtures("in_process")
def test_a_log_given_twice_is_refused_before_it_is_converted_twice(small: tuple[Path, Path], tmp_path: Path) -> None:
    done = run("v2xpnp", small[0], small[0], "--map", small[1], "--out", tmp_path / "out", "--workers", "1")
    assert done.exit_code == 2
    assert f"Error: {small[0]}: expected every log once, found it twice" in done.stderr
    assert done.stderr.splitlines()[0] == "1/1  small: passed"
    assert "1 of 1 scenarios meet every target; 1 log unusable" in done.stdout


@pytest.mark.usefixtures("in_process")
def test_a_cav_that_is_not_there(small: tuple[Path, Path], tmp_path: Path) -> None:
    sentence = refused(tmp_path, "v2xpnp", small[0], "--map", small[1], "--cavs", "7")
    assert sentence.startswith(f"{small[0]}: CAV 7: expected one of the vehicles 11, 12, cav_1, cav_2, found none")
    assert refused(tmp_path, "v2xpnp", small[0], "--map", small[1], "--cavs", "cav").endswith("2 whose names begin so")
