"""`mdrive-sumo convert` with missing packages, a full disk, interruption and existing output."""

import resource
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from testing.convert_command import refused, run

pytestmark = pytest.mark.slow

COMMAND = (sys.executable, "-c", "from mdrive_sumo.cli import main; main()", "convert")


CONTENT = {
    "commonroad": '<commonRoad commonRoadVersion="2020a" timeStepSize="0.1"><lanelet id="1"/></commonRoad>',
}


def missing_module(folder: Path, name: str) -> None:
    folder.mkdir()
    (folder / f"{name}.py").write_text(f"raise ModuleNotFoundError('No module named {name}', name={name!r})\n")


@pytest.mark.usefixtures("in_process")
def test_netconvert_missing_names_the_extra(
    small: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "empty" / "sumo").mkdir(parents=True)
    (tmp_path / "empty" / "sumo" / "__init__.py").touch()
    monkeypatch.syspath_prepend(tmp_path / "empty")
    monkeypatch.delitem(sys.modules, "sumo", raising=False)
    monkeypatch.setenv("PATH", "")
    sentence = refused(tmp_path, "v2xpnp", small[0], "--map", small[1])
    assert "netconvert: expected SUMO's programs, found none (pip install '.[convert]')" in sentence


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize(
    ("source", "module", "file"),
    [
        ("argoverse2", "pyarrow", "log/scenario_x.parquet"),
        ("commonroad", "commonroad.common.file_reader", "log/a.xml"),
    ],
)
def test_a_missing_package_names_the_extra(
    source: str, module: str, file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, module, None)  # importing it fails
    (tmp_path / "log").mkdir()
    (tmp_path / file).write_text(CONTENT.get(source, "nothing"))
    sentence = refused(tmp_path, source, tmp_path / "log")
    assert ".[convert]" in sentence
    assert module.partition(".")[0] in sentence


def test_a_missing_package_of_a_worker_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    missing_module(tmp_path / "missing", "yaml")
    frame = tmp_path / "log/1/000000.yaml"
    frame.parent.mkdir(parents=True)
    frame.write_text("vehicles: [\n")
    monkeypatch.syspath_prepend(tmp_path / "missing")  # workers get the path of their parent
    sentence = refused(tmp_path, "v2xpnp", tmp_path / "log", "--map", tmp_path / "map.pkl")
    assert ".[convert]" in sentence
    assert "yaml" in sentence


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


@pytest.mark.parametrize("most_bytes", [pytest.param(100, marks=pytest.mark.full), 6_000])
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


@pytest.mark.full  # in `make test`: a full disk leaves nothing either; Ctrl-C during eval (test_cli_eval)
def test_ctrl_c_leaves_nothing(small: tuple[Path, Path], tmp_path: Path) -> None:
    logs = tmp_path / "logs"
    for k in range(30):  # many more than are converted
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
