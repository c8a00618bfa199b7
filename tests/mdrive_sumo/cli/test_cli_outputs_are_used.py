"""What a command leaves is of use to another one, and a run says what it costs before it starts."""

import re
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import CliRunner, Result

from mdrive_sumo.cli import main
from mdrive_sumo.cli.evaluate import describe_cost
from mdrive_sumo.roads import list_packaged_networks
from mdrive_sumo.runs.prepared_run import prepare
from mdrive_sumo.runs.run_config import RunConfig


def call(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


@pytest.fixture
def converted(tmp_path: Path) -> Path:
    """What `convert opendrive` leaves: networks."""
    folder = tmp_path / "maps" / "networks"
    folder.mkdir(parents=True)
    for name in ("boulevard", "village_street"):
        (folder / name).symlink_to(list_packaged_networks()[name])
    return folder.parent


def test_networks_of_ones_own_are_listed(converted: Path) -> None:
    for folder in (converted, converted / "networks"):
        rows = [line.split()[0] for line in call("list", "networks", folder).output.splitlines()[2:]]
        assert rows == ["boulevard", "village_street"]
    refused = call("list", "networks", converted / "networks" / "boulevard" / "nothing")
    assert (refused.exit_code, "expected networks in NAME/network.json" in refused.output) == (2, True)


@pytest.mark.slow
def test_networks_of_ones_own_are_drawn(converted: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    done = call("show", converted / "networks" / "village_street", "--out", "one.png")
    assert (done.exit_code, done.output) == (0, "one.png\n")
    assert Path("one.png").stat().st_size > 5000
    refused = call("show", converted, "--out", "two.png")
    assert (refused.exit_code, "--out: expected one network with it, found 2" in refused.output) == (2, True)
    assert call("show", converted).output.split() == ["boulevard.png", "village_street.png"]


def test_the_conversion_names_the_commands_that_take_its_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    @dataclass
    class Town:
        name: str = "Town"
        stop_signs: int | None = None
        left_hand: bool = False
        repairs: tuple[str, ...] = ()
        measured_lanes: int = 0
        displaced_lanes: int = 0

    from real2sim.carla import opendrive_converter

    monkeypatch.setattr(opendrive_converter, "convert_opendrive", lambda *_: [Town()])
    done = call("convert", "opendrive", tmp_path / "Town.xodr", "--out", tmp_path / "my maps")
    assert f"Draw them: mdrive-sumo show '{tmp_path / 'my maps'}'" in done.output
    assert "schema suite" in done.output


def test_a_run_says_what_it_drives_before_it_starts(tmp_path: Path) -> None:
    whole = describe_cost(prepare(RunConfig(suite="interdrive@0", out=tmp_path)))
    assert re.fullmatch(
        r"46 episodes \(46 scenarios\), 1\d\d drives of CAVs, at most \d+ min of simulated time;"
        r" --scenario GLOB drives fewer",
        whole,
    )
    part = describe_cost(prepare(RunConfig(suite="interdrive@0", out=tmp_path, scenario="i01*", seeds=(1, 2, 3))))
    assert part == "3 episodes (1 scenario, 3 seeds), 6 drives of CAVs, at most 2 min of simulated time"


@pytest.mark.parametrize("has_images", [True, False])
def test_images_that_were_asked_for_and_not_kept_are_mentioned(tmp_path: Path, has_images: bool) -> None:
    from mdrive_sumo.cli.evaluate import _list_written_files

    if has_images:
        (tmp_path / "cameras").mkdir()
    run = SimpleNamespace(folder=tmp_path, config=RunConfig(record_cameras=True))
    said = _list_written_files(run)  # pyright: ignore[reportArgumentType]
    assert ("no camera images: --record-cameras keeps those of kind rgb" in said) is not has_images
