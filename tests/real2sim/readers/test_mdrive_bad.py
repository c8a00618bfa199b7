"""MDrive directories that cannot be read: one sentence each, which names the file."""

from collections.abc import Callable, Mapping
from pathlib import Path

import pytest
from testing.mdrive_directory import EGO, NEXT, TIMED, WALK, Directory, xml

from mdrive_sumo.core.errors import InputError
from real2sim.readers.mdrive import read_mdrive
from real2sim.readers.mdrive_manifest import MANIFEST, read_manifest


@pytest.fixture
def directory(tmp_path: Path) -> Directory:
    return Directory(tmp_path)


Spoil = Callable[[Directory], object]


def _write(file: str, text: str) -> Spoil:
    return lambda directory: (directory.write(), (directory.folder / file).write_text(text))


def _add(key: str, text: str, **entry: object) -> Spoil:
    return lambda directory: (directory.add(key, "a.xml", text, **entry), directory.write())


def _behave(action: object, actor: str = "a", **trigger: object) -> Spoil:
    def spoil(directory: Directory) -> None:
        directory.add("npc", "a.xml", WALK, name="a")
        directory.behave(actor, action, **trigger)
        directory.write()

    return spoil


def _missing(directory: Directory) -> None:
    directory.add("npc", "a.xml", WALK, name="a")
    (directory.write() / "a.xml").unlink()


BAD: Mapping[str, tuple[Spoil, str]] = {
    "no manifest": (lambda d: None, "actors_manifest.json: cannot be read"),
    "broken manifest": (_write("actors_manifest.json", '{"ego": ['), "actors_manifest.json: expected JSON"),
    "no text": (_write("actors_manifest.json", "\ud800".encode("utf-16", "surrogatepass").decode("latin-1")), "JSON"),
    "manifest a list": (_write("actors_manifest.json", "[]"), "valid dictionary"),
    "unknown key": (_write("actors_manifest.json", '{"dragons": []}'), "found 'dragons'"),
    "no file": (_write("actors_manifest.json", '{"npc": [{"name": "a"}]}'), "npc.0.file"),
    "file missing": (_missing, "expected its file a.xml to be there"),
    "file elsewhere": (
        _write("actors_manifest.json", '{"ego": [{"file": "../../etc_0.xml"}]}'),
        "expected a file in the scenario's folder, found '../../etc_0.xml'",
    ),
    "no CAV": (
        lambda d: (d.manifest.update(ego=[]), d.write(), [file.unlink() for file in d.folder.glob("*.xml")]),
        "route files NAME_<number>.xml of CAVs, found none",
    ),
    "CAV without number": (
        lambda d: (d.add("ego", "first.xml", EGO), d.write()),
        "expected a file NAME_<number>.xml, found 'first.xml'",
    ),
    "CAV twice": (lambda d: (d.add("ego", "other_1.xml", EGO), d.write()), "one file for each CAV, found 1 twice"),
    "CAVs in two towns": (
        _write("x_vehicle_2_1.xml", NEXT.replace("TownXX", "Town01")),
        "expected route '5' in TownXX",
    ),
    "CAVs of two routes": (_write("x_vehicle_2_1.xml", NEXT.replace('"5"', '"6"')), "found route '6' in TownXX"),
    "broken XML": (_write("x_vehicle_2_1.xml", NEXT[:-4]), "well-formed XML"),
    "empty CAV route": (_write("x_vehicle_2_1.xml", xml([])), "at least 2 waypoint(s), found 0"),
    "empty route": (_add("npc", xml([])), "a.xml: expected at least 1 waypoint(s), found 0"),
    "no number": (
        _add("npc", WALK.replace('"60"', '"six"')),
        "a.xml: waypoint: x: expected a finite number, found 'six'",
    ),
    "yaw no number": (_add("npc", WALK.replace('"-90"', '"N"')), "waypoint: yaw: expected a finite number"),
    "times backwards": (_add("npc", xml(TIMED[::-1])), "expected times that increase, found 0.6 s after 0.7 s"),
    "far away": (_add("npc", xml([(2e6, 0, 0), (0, 0, 0)])), "a.xml: x"),
    "size no number": (_add("static", xml([(1, 1, 0)], length="long")), "route: length: expected a finite number"),
    "size negative": (_add("static", xml([(1, 1, 0)], length="-2")), "a.xml: length: "),
    "speed of light": (_add("npc", WALK, speed=3e8), "npc.0.speed"),
    "weather no number": (
        _write("x_vehicle_1_0.xml", EGO.replace("<waypoint", '<weather cloudiness="a lot"/><waypoint', 1)),
        "weather: cloudiness: expected a finite number, found 'a lot'",
    ),
    "broken behaviours": (_write("actors_behavior.json", "{"), "actors_behavior.json: expected JSON"),
    "behaviours a list": (_write("actors_behavior.json", "[]"), "actors_behavior.json: the file"),
    "unknown actor": (
        _behave(None, "ghost"),
        "behavior 0: actor_name: expected an actor of the manifest (a), found 'ghost'",
    ),
    "unknown vehicle": (
        _behave(None, vehicle="Vehicle 9"),
        "trigger: vehicle: expected one of Vehicle 1, Vehicle 2, found 'Vehicle 9'",
    ),
    "unknown target": (
        _behave({"type": "lane_change", "target_vehicle": "Vehicle 0"}),
        "action: target_vehicle: expected one of Vehicle 1, Vehicle 2, found 'Vehicle 0'",
    ),
    "unknown trigger": (_behave(None, type="full_moon"), "distance_to_vehicle"),
    "unknown action": (_behave({"type": "fly"}), "'start_motion', 'hard_brake' or 'lane_change', found 'fly'"),
    "unknown side": (_behave({"type": "lane_change", "direction": "up"}), "found 'up'"),
    "distance no number": (_behave(None, distance_m="near"), "distance_m"),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", BAD)
def test_bad_directories_are_refused_in_one_sentence(directory: Directory, case: str) -> None:
    spoil, sentence = BAD[case]
    spoil(directory)
    with pytest.raises(InputError) as caught:
        read_mdrive(directory.folder, directory.towns)
    assert sentence in str(caught.value)
    assert str(directory.folder) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_byte_order_mark_before_the_manifest_is_ignored(tmp_path: Path) -> None:
    (tmp_path / MANIFEST).write_bytes(b'\xef\xbb\xbf{"ego": [{"file": "a_0.xml"}]}')
    assert [entry.file for _, entry in read_manifest(tmp_path)] == ["a_0.xml"]
