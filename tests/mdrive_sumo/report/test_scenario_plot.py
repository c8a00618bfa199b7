"""Pictures show what a scenario holds."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.image import imread
from testing.actors_world import actor

from mdrive_sumo.report.palette import CAV_COLOURS, KIND_COLOURS, LIGHT
from mdrive_sumo.report.scenario_plot import BUILDING, save_scenario_plot
from mdrive_sumo.roads import find_network_folder, load_road_map
from mdrive_sumo.scenario.background import Background, BackgroundVehicle
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import load_suite


def scenario(start: str) -> Scenario:
    return next(one for one in load_suite("interdrive@0").scenarios if one.id.startswith(start))


def drawn(one: Scenario, path: Path) -> Path:
    save_scenario_plot(one, load_road_map(find_network_folder(one.network)), path, dpi=70)
    return path


def pixels(path: Path, colour: str) -> int:
    """Pixels of exactly this colour."""
    return int((np.abs(imread(path)[..., :3] - to_rgb(colour)).max(-1) < 0.006).sum())


@pytest.mark.slow
def test_every_cav_and_the_houses_are_in_the_picture(tmp_path: Path) -> None:
    one = scenario("i38")
    path = drawn(one, tmp_path / "new" / "i38.png")
    assert all(pixels(path, colour) > 50 for colour in CAV_COLOURS[: len(one.egos)])
    assert pixels(path, BUILDING) > 5000


@pytest.mark.slow
def test_an_absent_cav_is_not(tmp_path: Path) -> None:
    assert pixels(drawn(scenario("i07"), tmp_path / "i07.png"), CAV_COLOURS[2]) == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("start", "words"), [("i13", ("i13_ins_sl_minor_road", "STOP", f"fill: {LIGHT['bad']}")), ("i46", ("hw_c",))]
)
def test_names_and_signs_are_written(tmp_path: Path, start: str, words: tuple[str, ...]) -> None:
    text = drawn(scenario(start), tmp_path / "picture.svg").read_text()
    assert all(word in text for word in words)


@pytest.mark.slow
def test_background_cars_wait_where_they_depart(tmp_path: Path) -> None:
    one = scenario("i07")
    car = BackgroundVehicle(id="car", depart_s=0, edges=("east_in",), depart_lane=1, depart_pos_m=70)
    before = pixels(drawn(one, tmp_path / "before.png"), LIGHT["vehicle"])
    busy = one.model_copy(update={"background": Background(vehicles=(car,))})
    assert pixels(drawn(busy, tmp_path / "busy.png"), LIGHT["vehicle"]) > before + 50


def test_an_unknown_format_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="docx"):
        drawn(scenario("i07"), tmp_path / "i07.docx")


@pytest.mark.slow
def test_scripted_road_users_stand_out_by_kind_and_are_named_in_a_legend(tmp_path: Path) -> None:
    one = scenario("i07")
    start = one.egos[0].start
    kinds = ("pedestrian", "cyclist", "static")
    cast = tuple(actor(kind, kind, at=(start.x + 6 * i, start.y + 6)) for i, kind in enumerate(kinds, 1))
    busy = one.model_copy(update={"actors": cast})
    before, after = drawn(one, tmp_path / "before.png"), drawn(busy, tmp_path / "busy.png")
    for kind in kinds:
        assert pixels(after, KIND_COLOURS[kind]) > pixels(before, KIND_COLOURS[kind]) + 10
    text = drawn(busy, tmp_path / "busy.svg").read_text()
    assert all(kind in text for kind in kinds)
