"""Unusable input of `mdrive-sumo convert`: one sentence, exit code 2, and nothing is left behind."""

import math
import os
import pickle
import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result
from testing.small_log import road, write_small_log

from mdrive_sumo.cli import main
from real2sim.hd_map import HdMap
from real2sim.pipeline.log_conversion import MAX_LOG_S

COMMAND = (sys.executable, "-c", "from mdrive_sumo.cli import main; main()", "convert")


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    return write_small_log(tmp_path_factory.mktemp("small"))


def run(*arguments: object) -> Result:
    return CliRunner().invoke(main, ["convert", *map(str, arguments)])


def refused(tmp_path: Path, *arguments: object) -> str:
    """The one sentence of a command that must fail and leave nothing behind."""
    before = sorted(tmp_path.iterdir())
    done = run(*arguments, "--out", tmp_path / "out", "--workers", "1")
    assert done.exit_code == 2, done.output
    assert sorted(tmp_path.iterdir()) == before
    assert done.stdout == ""
    (sentence,) = [line for line in done.stderr.splitlines() if line.startswith("Error: ")]
    assert "Traceback" not in done.stderr
    return sentence.removeprefix("Error: ")


def truncated(log: Path) -> None:
    file = log / "1" / "000020.yaml"
    file.write_text(file.read_text()[: len(file.read_text()) // 2])


def without_agent(log: Path) -> None:
    shutil.rmtree(log / "1")


def with_hole(log: Path) -> None:
    (log / "-1" / "000007.yaml").unlink()


def ending_early(log: Path) -> None:
    (log / "2" / "000040.yaml").unlink()


def with_nan(log: Path) -> None:
    file = log / "2" / "000003.yaml"
    head, _, rest = file.read_text().partition("lidar_pose:\n- ")
    assert rest
    file.write_text(f"{head}lidar_pose:\n- .nan\n{rest.partition(chr(10))[2]}")


BROKEN: dict[Callable[[Path], None], str] = {
    truncated: "1/000020.yaml",
    without_agent: "no folder 1",
    with_hole: "expected all frames from 000000 to 000040, found no 000007.yaml",
    ending_early: "expected the same frames as the other agents have, found no frame 000040",
    with_nan: "2/000003.yaml",
}


def test_every_broken_log_of_a_batch_is_told_in_a_sentence(small: tuple[Path, Path], tmp_path: Path) -> None:
    for spoil in BROKEN:
        shutil.copytree(small[0], tmp_path / "logs" / spoil.__name__)
        spoil(tmp_path / "logs" / spoil.__name__)
    done = run("v2xpnp", tmp_path / "logs", "--map", small[1], "--out", tmp_path / "out", "--workers", "2")
    assert done.exit_code == 2
    sentences = [line for line in done.stderr.splitlines() if ": expected " in line]
    assert len(sentences) == len(BROKEN)
    for spoil, words in BROKEN.items():
        (sentence,) = [line for line in sentences if f"logs/{spoil.__name__}" in line]
        assert words in sentence
        assert "found" in sentence
    assert [path.name for path in tmp_path.iterdir()] == ["logs"]


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


def test_an_empty_map(small: tuple[Path, Path], tmp_path: Path) -> None:
    _, map_ = write_small_log(tmp_path / "log", HdMap())
    sentence = refused(tmp_path, "v2xpnp", small[0], "--map", map_)
    assert "log/map.pkl" in sentence
    assert "lane" in sentence
    assert "found none" in sentence


def test_a_map_of_another_place_says_how_far(small: tuple[Path, Path], tmp_path: Path) -> None:
    _, map_ = write_small_log(tmp_path / "log", road(y=500.0))
    sentence = refused(tmp_path, "v2xpnp", small[0], "--map", map_)
    assert "median 500 m" in sentence
    assert "map of another place" in sentence


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


def test_an_unsupported_commonroad_version(tmp_path: Path) -> None:
    path = tmp_path / "old.xml"
    path.write_text('<commonRoad commonRoadVersion="2017a" timeStepSize="0.1"><lanelet id="1"/></commonRoad>')
    sentence = refused(tmp_path, "commonroad", path)
    assert "old.xml: commonRoadVersion: expected 2018b or 2020a, found '2017a'" in sentence


def test_a_long_log_proposes_a_window(tmp_path: Path) -> None:
    names = "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width"
    rows = [f"1,{k + 1},{100 * (k + 1)},car,{k / 20:.2f},0,0.5,0,0,4.5,1.8" for k in range(10 * round(MAX_LOG_S) + 2)]
    (tmp_path / "vehicle_tracks_000.csv").write_text("\n".join((names, *rows)) + "\n")
    (tmp_path / "map.osm").write_text(lanelet())
    sentence = refused(tmp_path, "interaction", tmp_path)
    assert "expected at most 60 s, found a log of 60.1 s: choose a part with --window 0,20" in sentence


def test_a_log_too_short_for_the_checks_is_refused(small: tuple[Path, Path], tmp_path: Path) -> None:
    sentence = refused(tmp_path, "v2xpnp", small[0], "--map", small[1], "--window", "0,0.5")
    assert f"{small[0]}: expected at least 2 s, found 0.5 s" in sentence


def test_a_log_given_twice_is_refused_before_it_is_converted_twice(small: tuple[Path, Path], tmp_path: Path) -> None:
    done = run("v2xpnp", small[0], small[0], "--map", small[1], "--out", tmp_path / "out", "--workers", "1")
    assert done.exit_code == 2
    assert f"Error: {small[0]}: expected every log once, found it twice" in done.stderr
    assert done.stderr.splitlines()[0] == "1/1  small: passed"
    assert "1 of 1 scenarios meet every target; 1 log unusable" in done.stdout


def test_a_cav_that_is_not_there(small: tuple[Path, Path], tmp_path: Path) -> None:
    sentence = refused(tmp_path, "v2xpnp", small[0], "--map", small[1], "--cavs", "7")
    assert sentence.startswith(f"{small[0]}: CAV 7: expected one of the vehicles 11, 12, cav_1, cav_2, found none")
    assert refused(tmp_path, "v2xpnp", small[0], "--map", small[1], "--cavs", "cav").endswith("2 whose names begin so")


CONTENT = {
    "commonroad": '<commonRoad commonRoadVersion="2020a" timeStepSize="0.1"><lanelet id="1"/></commonRoad>',
    "v2xpnp": "vehicles: [",
}


def missing_module(folder: Path, name: str) -> None:
    folder.mkdir()
    (folder / f"{name}.py").write_text(f"raise ModuleNotFoundError('No module named {name}', name={name!r})\n")


def test_netconvert_missing_names_the_extra(
    small: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "empty" / "sumo").mkdir(parents=True)
    (tmp_path / "empty" / "sumo" / "__init__.py").touch()
    monkeypatch.syspath_prepend(tmp_path / "empty")  # workers get the path of their parent
    monkeypatch.setenv("PATH", "")
    sentence = refused(tmp_path, "v2xpnp", small[0], "--map", small[1])
    assert "netconvert: expected SUMO's programs, found none (pip install 'mdrive-sumo[convert]')" in sentence


@pytest.mark.parametrize(
    ("source", "module", "file"),
    [
        ("argoverse2", "pyarrow", "log/scenario_x.parquet"),
        ("commonroad", "commonroad", "log/a.xml"),
        ("v2xpnp", "yaml", "log/1/000000.yaml"),
    ],
)
def test_a_missing_package_names_the_extra(
    source: str, module: str, file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    missing_module(tmp_path / "missing", module)
    (tmp_path / file).parent.mkdir(parents=True)
    (tmp_path / file).write_text(CONTENT.get(source, "nothing"))
    monkeypatch.syspath_prepend(tmp_path / "missing")
    more = ("--map", tmp_path / "map.pkl") if source == "v2xpnp" else ()
    sentence = refused(tmp_path, source, tmp_path / "log", *more)
    assert "mdrive-sumo[convert]" in sentence
    assert module in sentence


def test_the_command_explains_itself_without_the_extra() -> None:
    code = """
import sys
class Without:
    def find_spec(self, name, *_):
        if name.partition(".")[0] in {"pyarrow", "commonroad", "yaml", "pyproj", "sumo", "scipy"}:
            raise ModuleNotFoundError(name, name=name)
sys.meta_path.insert(0, Without())
from mdrive_sumo.cli import main
main(["convert", "v2xpnp", "--help"])
"""
    done = subprocess.run((sys.executable, "-c", code), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "Convert V2XPnP scenarios" in done.stdout


def test_help_waits_for_no_simulator() -> None:
    code = "import sys, real2sim.cli; print(sorted({'libsumo', 'pydantic', 'scipy', 'shapely'} & set(sys.modules)))"
    done = subprocess.run((sys.executable, "-c", code), capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


@pytest.mark.slow
@pytest.mark.parametrize("most_bytes", [100, 6_000])
def test_a_disk_that_is_full_half_way_leaves_nothing(most_bytes: int, small: tuple[Path, Path], tmp_path: Path) -> None:
    """No file may grow beyond the limit: the first one, or the quality.json."""
    done = subprocess.run(
        (*COMMAND, "v2xpnp", small[0], "--map", small[1], "--out", tmp_path / "out", "--report"),
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (most_bytes, most_bytes)),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2, done.stderr
    (sentence,) = [line for line in done.stderr.splitlines() if line.startswith("Error: ")]
    assert "File too large" in sentence or "netconvert" in sentence
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_ctrl_c_leaves_nothing(small: tuple[Path, Path], tmp_path: Path) -> None:
    logs = tmp_path / "logs"
    for k in range(30):
        shutil.copytree(small[0], logs / f"log{k}")
    process = subprocess.Popen(
        (*COMMAND, "v2xpnp", logs, "--map", small[1], "--out", tmp_path / "out", "--workers", "1"),
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    process.stderr.readline()  # the first log is done
    assert len(list(tmp_path.iterdir())) == 2, "it works beside its result"
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=60)
    assert process.returncode == 130
    assert [path.name for path in tmp_path.iterdir()] == ["logs"]


@pytest.mark.parametrize("kind", ["file", "full"])
def test_a_result_is_not_written_over(kind: str, small: tuple[Path, Path], tmp_path: Path) -> None:
    out = tmp_path / "out"
    if kind == "file":
        out.touch()
    else:
        out.mkdir()
        (out / "mine").touch()
    done = run("v2xpnp", small[0], "--map", small[1], "--out", out)
    assert done.exit_code == 2
    assert "expected a new or empty folder to write to, found something there" in done.stderr


@pytest.mark.parametrize(
    ("option", "value", "words"),
    [
        ("--window", "3", "expected START,END"),
        ("--window", "3,1", "expected 0 <= START < END"),
        ("--cavs", "1,,2", "expected names between commas"),
        ("--name", "a/b", "expected letters, digits"),
    ],
)
def test_options_that_say_nothing(
    option: str, value: str, words: str, small: tuple[Path, Path], tmp_path: Path
) -> None:
    done = run("v2xpnp", small[0], "--map", small[1], "--out", tmp_path / "out", option, value)
    assert done.exit_code == 2
    assert words in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_authored_sources_need_a_map(tmp_path: Path) -> None:
    assert run("mdrive", tmp_path, "--out", tmp_path / "out").exit_code == 2
    done = run("interdrive", tmp_path, "--out", tmp_path / "out")
    assert "expected the maps of the CARLA towns, found no --towns" in done.stderr
    assert "expected the vector map, found no --map" in run("v2xpnp", tmp_path, "--out", tmp_path / "out").stderr
