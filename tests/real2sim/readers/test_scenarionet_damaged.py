"""ScenarioNet: damaged and malicious descriptions."""

import copy
import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from testing.sampling import examples
from testing.scenarionet_samples import FRAMES, Description, description, read, straight

from mdrive_sumo.core.errors import InputError
from real2sim.readers.safe_pickle import load_pickle
from real2sim.readers.scenarionet import read_scenarionet


# --- damaged and hostile files ---
class _Exploit:
    def __init__(self, trace: Path) -> None:
        self.trace = trace

    def __reduce__(self) -> tuple[Callable[[str], int], tuple[str]]:
        return os.system, (f"touch {self.trace}",)


@pytest.mark.parametrize("where", ["metadata", "tracks", "map_features"])
def test_an_exploit_is_refused_by_name_and_not_executed(tmp_path: Path, where: str) -> None:
    trace = tmp_path / "executed"
    raw = description()
    raw[where]["planted"] = _Exploit(trace)
    with pytest.raises(InputError, match=r"scenario\.pkl: expected .* found the class (posix|nt)\.system; nothing was"):
        read(tmp_path, raw)
    assert not trace.exists()


@pytest.mark.parametrize(
    ("code", "name"),
    [
        (b"cbuiltins\neval\n(S'1+1'\ntR.", r"builtins\.eval"),
        (b"cnumpy\nload\n(S'/etc/passwd'\ntR.", r"numpy\.load"),
        (b"\x80\x04\x8c\x0creal2sim.cli\x8c\x07convert\x93.", r"real2sim\.cli\.convert"),
        (b"\x80\x04\x8c\x05numpy\x8c\x11ndarray.__class__\x93.", r"numpy\.ndarray\.__class__"),
    ],
)
def test_classes_are_refused_by_name(tmp_path: Path, code: bytes, name: str) -> None:
    path = tmp_path / "x.pkl"
    path.write_bytes(code)
    with pytest.raises(InputError, match=name):
        load_pickle(path)


def test_a_truncated_file_is_one_sentence_wherever_it_ends(tmp_path: Path) -> None:
    whole = pickle.dumps(description())
    path = tmp_path / "scenario.pkl"
    for end in range(0, len(whole), 7):
        path.write_bytes(whole[:end])
        with pytest.raises(InputError, match=r"^[^\n]*scenario\.pkl: expected [^\n]*found[^\n]*$"):
            read_scenarionet(path)


def _set(*keys: Any, to: Any) -> Callable[[Description], None]:
    def change(raw: Description) -> None:
        place: Any = raw
        for key in keys[:-1]:
            place = place[key]
        if to is KeyError:
            del place[keys[-1]]
        else:
            place[keys[-1]] = to

    return change


POSITION = ("tracks", "1", "state", "position")


NAN = np.array([(0.0, 0.0)] * 3 + [(np.nan, 1.0)] + [(0.0, 0.0)])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_set("tracks", to=KeyError), "tracks: expected a dict, found NoneType"),
        (_set("tracks", to={}), "tracks: expected at least one with a valid frame, found none"),
        (_set("map_features", to=KeyError), "map_features: expected a dict"),
        (_set("map_features", to={}), "expected at least one lane, found none in 0 features"),
        (_set("map_features", "7", "type", to="DRIVEWAY"), "expected at least one lane, found none in 0 features"),
        (_set("map_features", "7", to=[1]), r"map_features\.7: expected a dict, found list"),
        (_set("map_features", "7", "type", to=3), r"map_features\.7\.type: expected a word, found 3"),
        (_set("map_features", "7", "polyline", to=KeyError), "expected at least one lane, found none in 0 features"),
        (_set("map_features", "7", "polyline", to=[]), "expected at least one lane, found none in 0 features"),
        (_set("map_features", "7", "polyline", to=[(1,)]), r"7: expected points with x and y, found \[\(1,\)\]"),
        (
            _set("map_features", "7", "polyline", to=[(1, 2), (3,)]),
            r"7: expected numbers, found \[\(1, 2\), \(3,\)\]",
        ),
        (_set("map_features", "7", "polyline", to=NAN), r"map_features\.7: expected finite .* found \[nan, 1\.0\]"),
        (_set("map_features", "7", "exit_lanes", to=8), r"map_features\.7\.exit_lanes: expected a list, found int"),
        (_set("map_features", "7", "speed_limit_kmh", to="fast"), "expected a finite number, found 'fast'"),
        (_set("map_features", "7", "left_boundaries", to=["50"]), "left_boundaries: expected dicts, found str"),
        (_set("dynamic_map_states", to=[1]), "dynamic_map_states: expected a dict, found list"),
        (_set("length", to=KeyError), "length: expected at least 2 frames, found None"),
        (_set("length", to=0), "length: expected at least 2 frames, found 0"),
        (_set("length", to=7), r"metadata\.ts: expected 7 growing times, found an array of float64 of shape \(5,\)"),
        (_set("metadata", to="nuscenes"), "metadata: expected a dict, found str"),
        (_set("metadata", "ts", to=np.zeros(FRAMES)), r"metadata\.ts: expected 5 growing times"),
        (_set("metadata", "ts", to="soon"), r"metadata\.ts: expected numbers, found 'soon'"),
        (_set("tracks", "1", to=4), r"tracks\.1: expected a dict with type and state, found int"),
        (
            _set("tracks", "1", "state", "valid", to=KeyError),
            r"tracks\.1: expected state\.valid, found heading, length",
        ),
        (_set("tracks", "1", "state", "heading", to=np.zeros(4)), "heading: expected 5 rows, found .* shape"),
        (_set("tracks", "1", "state", "heading", to="north"), "heading: expected numbers"),
        (
            _set(*POSITION, to=np.zeros(FRAMES)),
            r"expected 5 rows, found an array of float64 of shape \(5, 1\)",
        ),
        (_set(*POSITION, to=NAN), r"tracks\.1: position: expected finite x and y in frame 3, found \[nan, 1\.0\]"),
    ],
)
def test_bad_descriptions_are_refused(tmp_path: Path, change: Callable[[Description], None], message: str) -> None:
    raw = description()
    change(raw)
    with pytest.raises(InputError, match=message) as caught:
        read(tmp_path, raw)
    assert str(tmp_path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"expected a scenario description \(a dict\), found list"):
        read(tmp_path, [1, 2])
    with pytest.raises(InputError, match="cannot be read: No such file"):
        read_scenarionet(tmp_path / "absent.pkl")
    with pytest.raises(InputError, match="cannot be read: Is a directory"):
        read_scenarionet(tmp_path)
    text = tmp_path / "map.xml"
    text.write_text("<osm/>")
    with pytest.raises(InputError, match=r"map\.xml: expected a complete pickle"):
        read_scenarionet(text)


def _places(raw: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    below = [place for key in raw for place in _places(raw[key], (*path, key))] if isinstance(raw, dict) else []
    return [*([path] if path else []), *below]


RICH = description(
    "nuplan",
    map_features={
        "7": straight(entry_lanes=[1], exit_lanes=[2], left_neighbor=["3"], polygon=np.eye(3), width=np.ones((5, 2))),
        "8": straight(
            right_neighbor=[{"feature_id": 3, "self_start_index": 0, "self_end_index": 2}],
            right_boundaries=[{"boundary_feature_id": 9, "lane_start_index": 0, "lane_end_index": 2}],
            speed_limit_kmh=3.0,
        ),
        "9": {"type": "ROAD_LINE_SOLID_SINGLE_WHITE", "polyline": np.eye(3)},
        "10": {"type": "STOP_SIGN", "lane": [7], "position": np.zeros(3)},
        "11": {"type": "CROSSWALK", "polygon": np.eye(3)},
    },
    dynamic_map_states={"7": {"lane": "7", "stop_point": np.zeros(3)}},
)


WORDS: tuple[Any, ...] = (None, True, -1, 0.5, float("nan"), float("inf"), 10**400, "", "x", b"1")


LISTS: tuple[Any, ...] = ((), [], [None], [{}], {}, {"type": 1})


ARRAYS: tuple[Any, ...] = tuple(map(np.asarray, ([], [[], []], np.zeros((5, 2)), np.full((5, 3), np.nan), 1.0, ["a"])))


JUNK = st.sampled_from((*WORDS, *LISTS, *ARRAYS))


@pytest.mark.slow
@given(place=st.sampled_from(_places(RICH)), junk=JUNK)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=examples(75, 300))
def test_any_damage_is_read_or_refused_in_one_sentence(tmp_path: Path, place: tuple[Any, ...], junk: Any) -> None:
    raw = copy.deepcopy(RICH)
    _set(*place, to=junk)(raw)
    try:
        recording = read(tmp_path, raw)
    except InputError as error:
        assert "\n" not in str(error)
    else:
        assert recording.map.lanes
        assert recording.views[0].tracks
