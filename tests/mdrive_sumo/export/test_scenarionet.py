"""ScenarioNet: the published rules of `ScenarioDescription.sanity_check` (metadrive-simulator 0.4.3).

MetaDrive itself needs a 3-D engine of hundreds of megabytes, so its rules are repeated here from its documentation.
"""

import pickle
from typing import Any

import numpy as np
import pytest
from testing.mixed_run import SCENARIO

from mdrive_sumo.episode import EpisodeRecord
from real2sim.readers.scenarionet import read_scenarionet

from .conftest import Export

pytestmark = pytest.mark.slow  # of an episode that is driven

NAME = f"sd_mdrive-sumo_v1_{SCENARIO}.pkl"
OBJECT_TYPES = {"VEHICLE", "PEDESTRIAN", "CYCLIST", "TRAFFIC_OBJECT"}
FEATURE_TYPES = {"LANE_SURFACE_STREET", "LANE_SURFACE_UNSTRUCTURE", "ROAD_EDGE_BOUNDARY", "CROSSWALK", "STOP_SIGN"}
PLAIN_TYPES = (int, float, str, np.ndarray, dict, list, tuple, type(None), set)
"""Anything else would tie the pickle to our code."""


@pytest.fixture(scope="module")
def description(exported: Export) -> dict[str, Any]:
    return pickle.loads((exported("scenarionet") / NAME).read_bytes())


def list_values(value: Any) -> list[Any]:
    parts = value.values() if isinstance(value, dict) else value if isinstance(value, list | tuple | set) else ()
    return [value, *(found for part in parts for found in list_values(part))]


def check_states(entry: dict[str, Any], id_: str, length: int) -> None:
    assert set(entry) >= {"type", "state", "metadata"}
    assert entry["metadata"]["object_id"] == id_ and entry["metadata"]["type"] == entry["type"]
    valid = entry["state"].get("valid")
    for name, values in entry["state"].items():
        assert len(values) == length, name
        if isinstance(values, np.ndarray) and valid is not None:
            assert values.ndim in (1, 2) and np.isfinite(values).all()
            assert not (values[..., :2] if name == "position" else values)[~valid].any(), name


def test_the_description_keeps_the_published_rules(description: dict[str, Any]) -> None:
    first = {"tracks", "version", "id", "dynamic_map_states", "map_features", "length", "metadata"}
    assert set(description) == first and type(description) is dict
    assert all(isinstance(value, PLAIN_TYPES) for value in list_values(description))
    assert {"metadrive_processed", "coordinate", "ts"} <= set(description["metadata"])
    assert description["metadata"]["ts"].shape == (description["length"],)
    for id_, track in description["tracks"].items():
        check_states(track, id_, description["length"])
        assert track["type"] in OBJECT_TYPES and {"position", "heading"} <= set(track["state"])
        assert track["state"]["valid"].any()
    for id_, light in description["dynamic_map_states"].items():
        check_states(light, id_, description["length"])
        assert light["lane"] in description["map_features"] and light["stop_point"].shape == (3,)
    for feature in description["map_features"].values():
        assert feature["type"] in FEATURE_TYPES
        assert "polyline" in feature or not feature["type"].startswith("LANE")


def test_tracks_are_the_recorded_poses_at_ten_a_second(description: dict[str, Any], record: EpisodeRecord) -> None:
    assert np.diff(description["metadata"]["ts"]) == pytest.approx(0.1)
    assert set(description["tracks"]) == set(record.ids)
    for n, id_ in enumerate(record.ids):
        state, valid = description["tracks"][id_]["state"], record.valid[::2, n]
        assert (state["valid"] == valid).all()
        xy = np.column_stack((record.x[::2, n], record.y[::2, n]))
        assert np.abs(state["position"][:, :2] - xy)[valid].max() < 1e-9
        assert np.abs(state["heading"] - record.yaw[::2, n])[valid].max() < 1e-9
        speed = np.hypot(*state["velocity"].T)
        assert np.abs(speed - np.abs(record.speed[::2, n]))[valid].max() < 1e-9


def test_the_data_set_has_its_two_index_files(exported: Export, description: dict[str, Any]) -> None:
    summary, mapping = (
        pickle.loads((exported("scenarionet") / f"dataset_{name}.pkl").read_bytes()) for name in ("summary", "mapping")
    )
    assert list(summary) == list(mapping) == [NAME]
    assert summary[NAME]["sdc_id"] == description["metadata"]["sdc_id"] == "0"
    assert summary[NAME]["number_summary"]["num_objects"] == len(description["tracks"])
    assert summary[NAME]["object_summary"]["cone"]["moving_distance"] == 0.0


def test_our_own_reader_takes_it_back(exported: Export, record: EpisodeRecord) -> None:
    """It reads untrusted pickles: these contain nothing but plain types and arrays."""
    log = read_scenarionet(exported("scenarionet") / NAME)
    assert (log.dt_s, log.cavs) == (0.1, ("0",))
    for track in log.views[0].tracks:
        n = record.ids.index(track.id)
        assert np.abs(track.x - record.x[::2, n])[track.valid].max() < 1e-9
