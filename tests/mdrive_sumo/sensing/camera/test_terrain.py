"""The ground: no grass on the road, wherever the camera is and whatever its direction."""

import numpy as np
import pytest
from testing.camera_scenes import build_camera, build_scene, find_eye, needs_opengl, place_car

from mdrive_sumo.contract import SemanticClass
from mdrive_sumo.roads import find_network_folder, load_road_map

pytestmark = needs_opengl
ON_THE_ROAD = {SemanticClass.ROAD, SemanticClass.ROAD_LINE}


@pytest.mark.parametrize(("height", "fov_deg"), [(2.3, 100.0), (1.6, 70.0)], ids=["tcp", "vad"])
def test_the_road_ahead_of_a_car_is_not_covered_by_grass(height: float, fov_deg: float) -> None:
    """A software renderer put one large piece of grass in front of the road in 4 of 10 images."""
    town = load_road_map(find_network_folder("main_street"))
    camera = build_camera(town, kind="semantic", width=200, height=112, z=height, fov_deg=fov_deg)
    covered = []
    lanes = [lane.centre for lane in town.driving if lane.centre.length > 20.0]
    places = [(*line.at(s), line.yaw_at(s)) for line in lanes for s in np.arange(2.0, line.length - 10.0, 15.0)]
    for place in places:
        scene = build_scene([place_car(*place)])
        image = camera.sense(scene, find_eye(scene))
        assert image is not None
        covered.append(SemanticClass(int(image.pixels[-1, 100])) not in ON_THE_ROAD)
    assert len(places) >= 20
    assert np.mean(covered) <= 0.05  # a lane may bend away under the car
