"""Places are drawn by kind, seed and parameters, written as network folders and read back; bad input is named."""

import json
from pathlib import Path

import pytest

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.roads import find_network_folder, load_road_map
from mdrive_sumo.worlds.places import PLACE_FILE, check_place, draw_place, read_place, write_place


def test_a_place_is_read_back_as_it_was_drawn(tmp_path: Path) -> None:
    place = draw_place("crossing", "a", arms=3)
    folder = write_place(place, tmp_path / place.name)
    assert sorted(file.name for file in folder.iterdir()) == ["map.net.xml.gz", "network.json", "place.json"]
    again = read_place(folder)
    assert (again.name, again.parameters) == (place.name, place.parameters)
    second = write_place(again, tmp_path / "second")
    assert all((second / file.name).read_bytes() == file.read_bytes() for file in folder.iterdir())
    roads = load_road_map(folder)
    assert roads.name == place.name
    assert check_place(roads) == []


def test_a_given_parameter_leaves_the_others_as_they_are() -> None:
    drawn = draw_place("crossing", 7)
    arms = 3 if drawn.parameters["arms"] != 3 else 4
    given = draw_place("crossing", 7, arms=arms)
    assert given.parameters == {**drawn.parameters, "arms": arms}
    assert given.name != drawn.name


def test_a_packaged_network_is_a_place_by_its_name(tmp_path: Path) -> None:
    folder = write_place(draw_place("side_street"), tmp_path / "side_street")
    packaged = find_network_folder("side_street")
    for name in ("map.net.xml.gz", "network.json"):
        assert (folder / name).read_bytes() == (packaged / name).read_bytes()
    assert read_place(folder).name == "side_street"


@pytest.mark.parametrize(
    ("kind", "parameters", "expected"),
    [
        ("crosing", {}, "place: expected one of .*did you mean 'crossing'"),
        ("crossing", {"arm": 3}, "parameter of place 'crossing': expected one of area, arms, .*did you mean 'arms'"),
        ("crossing", {"arms": 7}, "parameter 'arms' of place 'crossing': expected 3, 4, 5, found 7"),
        ("crossing", {"arms": True}, "expected 3, 4, 5, found True"),
        ("town_crossing", {"arms": 3}, "expected no parameters for a packaged network, found 'arms'"),
    ],
)
def test_bad_input_is_named(kind: str, parameters: dict[str, int], expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        draw_place(kind, 0, **parameters)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"version": 99}, "expected a place of version .* found version 99"),
        ({"kind": "castle"}, "place: expected one of"),
        ({"size": 3}, "size: Extra inputs are not permitted"),
    ],
)
def test_a_bad_place_file_is_named(tmp_path: Path, change: dict[str, object], expected: str) -> None:
    folder = write_place(draw_place("side_street"), tmp_path / "place")
    text = json.loads((folder / PLACE_FILE).read_text())
    (folder / PLACE_FILE).write_text(json.dumps({**text, **change}))
    with pytest.raises(InputError, match=expected):
        read_place(folder)
    (folder / PLACE_FILE).unlink()
    with pytest.raises(InputError, match="cannot be read"):
        read_place(folder)
