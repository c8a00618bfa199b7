"""The static scene of a network: what it holds, and that large networks are no trouble."""

import numpy as np
import pytest
import shapely

from mdrive_sumo.contract.sensors import SemanticClass
from mdrive_sumo.roads import find_network_folder, load_road_map
from mdrive_sumo.sensing.camera import static_scene
from mdrive_sumo.sensing.camera.meshes import build_mesh
from mdrive_sumo.sensing.camera.static_scene import GRID_M, SURROUNDINGS_M, find_surroundings, load_static_scene


def test_surroundings_are_the_envelope_of_a_buffer() -> None:
    points = np.random.default_rng(1).uniform(-300.0, 700.0, (12, 2))
    buffered = shapely.MultiPoint(points).buffer(SURROUNDINGS_M).envelope
    assert find_surroundings(points).bounds == pytest.approx(buffered.bounds)


def test_many_points_cost_nothing() -> None:
    """A buffer of them takes minutes and ten gigabytes."""
    along = np.linspace(0.0, 5000.0, 200_000)
    assert find_surroundings(np.column_stack((along, along))).bounds == pytest.approx(
        (-SURROUNDINGS_M, -SURROUNDINGS_M, 5000.0 + SURROUNDINGS_M, 5000.0 + SURROUNDINGS_M)
    )


def test_the_largest_network_has_a_scene() -> None:
    scene = load_static_scene(load_road_map(find_network_folder("hard_corridor_arterial")))
    assert len(scene.vertices["position"]) > 1000 and np.isfinite(scene.vertices["position"]).all()


def test_a_scene_does_not_depend_on_what_it_is_rounded_relative_to(monkeypatch: pytest.MonkeyPatch) -> None:
    roads = load_road_map(find_network_folder("hard_weave"))
    expected = load_static_scene.__wrapped__(roads)
    monkeypatch.setattr(static_scene, "GRID_M", 16.0)  # the scene's origin lies some of them away
    found = load_static_scene.__wrapped__(roads)
    assert np.abs(np.round(found.origin[:2] / 16.0)).min() >= 1
    assert found.vertices["kind"].tolist() == expected.vertices["kind"].tolist()
    np.testing.assert_allclose(found.vertices["position"], expected.vertices["position"], atol=1e-3)


def test_large_coordinates_lose_no_digits() -> None:
    """Networks of converted maps may keep coordinates of UTM, in millions of metres."""
    place = np.array((690_000.0, 5_330_000.0, 0.0))
    corner = GRID_M * np.round(place / GRID_M)
    triangle = np.array([[(0.0, 0.0, 0.0), (0.15, 0.0, 0.0), (0.0, 0.15, 0.0)]])
    mesh = build_mesh(place + triangle, (0, 0, 0), SemanticClass.ROAD, origin=corner)
    np.testing.assert_allclose(mesh["position"] - (place - corner), triangle[0], atol=1e-3)
