"""Radio scenes of an episode: stations, connected background vehicles, and what lies between them."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from mdrive_sumo.core.frozen import build_frozen
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.seeding import draw_first_uniform
from mdrive_sumo.core.state import Kind
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.sensing.building_edges import BuildingEdges
from mdrive_sumo.sensing.lidar_world import assume_vehicle_heights
from mdrive_sumo.sensing.link_classes import classify_links, list_blockers
from mdrive_sumo.sensing.sensing_frame import SensingFrame
from mdrive_sumo.sensing.street_corners import StreetCorners
from mdrive_sumo.v2x.radio.path_loss import Classes, LinkClass, RadioEnvironment
from mdrive_sumo.v2x.radio.radio_scene import RadioScene
from mdrive_sumo.v2x.radio.radio_settings import CornerModel, RadioSettings

ROADSIDE_ANTENNA_M = 5.0
"""[m] Height of a road-side unit's antenna: 3GPP TR 37.885, section 6.1."""
HIGHWAY_SPEED = 70 / 3.6
"""[m/s] Speed limit from which on a map is a highway: the lower of the two speeds of TR 37.885's highway."""


def choose_environment(roads: RoadMap) -> RadioEnvironment:
    """Return which formulas of TR 37.885 hold on a map: those of a highway if any road allows 70 km/h."""
    return RadioEnvironment.HIGHWAY if roads.legal_speed.max() >= HIGHWAY_SPEED - 0.1 else RadioEnvironment.URBAN


class RadioSceneBuilder:
    """Builds the radio scene of a tick."""

    def __init__(self, settings: RadioSettings, roads: RoadMap, seed: int) -> None:
        self._settings, self._seed = settings, seed
        self._edges = BuildingEdges(roads)
        self._corners = (
            StreetCorners(roads, self._edges) if settings.corner_model is CornerModel.VIRTUAL_SOURCE else None
        )
        self._connected: dict[str, bool] = {}
        """Whether a background vehicle is connected: for the whole episode."""
        self._ids: tuple[str, ...] = ()
        """Of the boxes in the tick before. What follows from them stays while they do: sizes never change."""
        self._blockers, self._roofs = np.zeros((0, 6)), np.zeros(0)
        self._background: list[int] = []

    def build(
        self,
        frame: SensingFrame,
        cavs: Sequence[str],
        roadside: Mapping[str, tuple[float, float]],
        with_background: bool,
    ) -> RadioScene:
        """Return the scene of these CAVs and road-side units, whose positions [m] are by id.

        with_background: whether connected background vehicles are needed. An antenna stands in the middle of a
        vehicle's roof.
        """
        boxes = frame.boxes
        row_by_id = {name: row for row, name in enumerate(frame.egos)}
        stations = tuple(sorted((*cavs, *roadside)))
        own = [row_by_id[name] if name not in roadside else -1 for name in stations]
        self._follow_boxes(frame)
        background = self._background if with_background else []
        carriers = np.array([*own, *background], dtype=np.int64)
        xy = np.empty((len(carriers), 2))
        xy[:, 0], xy[:, 1] = boxes.x[carriers], boxes.y[carriers]
        height = self._roofs[carriers]
        for i, name in enumerate(stations):
            if name in roadside:
                xy[i], height[i] = roadside[name], ROADSIDE_ANTENNA_M
        edges = self._edges
        links = classify_links(xy, carriers, len(own), self._blockers, edges.walls, edges.ends, edges.circles)
        corners = self._measure_corners(xy[: len(own)], height, links[0]) if self._corners is not None else None
        return build_frozen(RadioScene, stations, xy, height, boxes.speed[background], *links, corners)

    def _measure_corners(self, xy: Float, height: Float, classes: Classes) -> Float:
        """Return the losses (n, n) [dB] round corners, NaN where no building is in between or no crossing is seen."""
        losses = np.full((len(xy), len(xy)), math.nan)
        places = [(x, y) for x, y in xy.tolist()]
        for i, k in zip(*np.nonzero(np.triu(classes[:, : len(xy)] == LinkClass.NLOSB, 1)), strict=True):
            assert self._corners is not None, "asked for by another corner model"
            middle_m = math.sqrt(float(height[i] * height[k]))  # the break distance has the product of both
            losses[i, k] = losses[k, i] = self._corners.compute_loss(places[i], places[k], middle_m)
        return losses

    def _follow_boxes(self, frame: SensingFrame) -> None:
        """Take what blocks lines of sight, roofs [m], and background vehicles from the boxes of this tick."""
        boxes = frame.boxes
        if boxes.ids != self._ids:
            self._ids, self._blockers = boxes.ids, list_blockers(boxes)
            self._roofs, self._background = assume_vehicle_heights(boxes.length), self._list_background(frame)
        else:
            for i, column in enumerate((boxes.x, boxes.y, boxes.yaw)):
                self._blockers[:, i] = column

    def _list_background(self, frame: SensingFrame) -> list[int]:
        """Return the rows of connected background vehicles, by name."""
        if self._settings.connected_background == 0.0:
            return []
        ids, connected = frame.boxes.ids, self._connected
        vehicles = [row for row in np.flatnonzero(frame.boxes.kind == Kind.VEHICLE).tolist() if row >= len(frame.egos)]
        for name in [ids[row] for row in vehicles if ids[row] not in connected]:
            luck = draw_first_uniform(self._seed, "connected", name)
            connected[name] = luck < self._settings.connected_background
        return sorted([row for row in vehicles if connected[ids[row]]], key=ids.__getitem__)
