"""`codriving`: asks others for what matters for its driving, fuses it, forecasts occupancy, and plans on the forecast.

A counterpart of CoDriving (Liu et al. 2024, "Towards Collaborative Autonomous Driving: Simulation Platform and
End-to-End System"), not the original: docs/codriving.md.
"""

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from mdrive_sumo.agents.learned.anchor_planner import AnchorPlanner
from mdrive_sumo.agents.learned.box_decoding import DetectedBoxes
from mdrive_sumo.agents.learned.detector_agent import OPTIONS, FeatureSharingAgent, Scan, stack_maps
from mdrive_sumo.agents.learned.driving_request import (
    LEAST_WAY_M,
    REQUEST_GRID,
    WAY_S,
    build_demand,
    encode_request,
    find_demand,
    find_hidden,
)
from mdrive_sumo.agents.learned.ego_frame import convert_to_ego
from mdrive_sumo.agents.learned.feature_inbox import FeatureInbox
from mdrive_sumo.agents.learned.fusion_network import EncodedScan
from mdrive_sumo.agents.learned.fusion_spec import CODRIVING, LEAST_CONFIDENCE
from mdrive_sumo.agents.learned.occupancy_grid import OccupancyForecast, draw_tracks
from mdrive_sumo.agents.learned.shared_grids import encode_features
from mdrive_sumo.contract import Briefing, Message, Note, Objects, Observation
from mdrive_sumo.contract.agent_options import Option
from mdrive_sumo.perception.late_fusion import OPV2V_LIMITS

CAP = 5.0
"""[m/s] The paper's table of controllers caps CoDriving at it."""
REQUEST_AGE_TICKS = 10
"""A request holds for half a second: two may be lost, and a car at 8 m/s has moved by less than a cell of it."""
WAY_STEP_M = 2.0
"""[m] Between the points of the way ahead: a third of a cell of a request."""


class CoDrivingAgent(FeatureSharingAgent):
    """Counterpart of CoDriving: senders share what others ask for, occupancy is forecast; at most 5 m/s.

    Options as of `perception-swap:attfuse`: `weights`, `provider`, `score`, `budget`.
    """

    family, detector, weights = "", CODRIVING, CODRIVING
    cap: ClassVar[float] = CAP
    _planner: AnchorPlanner

    def start(self, briefing: Briefing) -> None:
        """Prepare the inboxes of features and of requests."""
        super().start(briefing)
        self._inbox = FeatureInbox(self._grid, OPV2V_LIMITS, (REQUEST_GRID,))
        self._requests = FeatureInbox(REQUEST_GRID, OPV2V_LIMITS, (self._grid,), REQUEST_AGE_TICKS)

    def _build_planner(self, briefing: Briefing) -> AnchorPlanner:
        return AnchorPlanner(briefing, self.cap)

    def _receive(self, messages: tuple[Message, ...]) -> tuple[Note, ...]:
        notes = self._inbox.receive(messages)
        self._requests.receive(messages)  # what it cannot read, the other inbox has noted
        return notes

    def _share(self, scan: Scan) -> tuple[Message, ...]:
        """Return the own request, and the tiles that others ask for and the own scan shows something in."""
        assert scan.encoded is not None
        pose = scan.build_pose()
        way = convert_to_ego(self._planner.list_way_ahead(scan.own, WAY_S, LEAST_WAY_M, WAY_STEP_M), scan.own)
        request = encode_request(build_demand(way, find_hidden(scan.cells)), pose)
        demand = find_demand(self._requests.collect(scan.tick, scan.own)).astype(np.float32)
        asked = EncodedScan(scan.encoded.features, np.clip(scan.encoded.confidence, 0.0, 1.0) * demand)
        budget = self._numbers["budget"] - sum(len(message.payload) for message in request)
        return request + encode_features(asked, pose, self._grid, budget, LEAST_CONFIDENCE)

    def _look(self, scan: Scan) -> DetectedBoxes:
        """Return what the network finds; the planner gets what it forecasts."""
        assert scan.encoded is not None
        tracks = draw_tracks(self._tracker.predict(scan.tick), scan.own)
        maps = stack_maps(scan.encoded, self._inbox.collect(scan.tick, scan.own))
        found, occupied = self._network.forecast(*maps, tracks)
        pose = np.array((scan.own.x, scan.own.y, scan.own.yaw))
        occupied = np.where(np.isfinite(occupied), np.clip(occupied, 0.0, 1.0), np.float32(1.0))
        self._planner.take_forecast(OccupancyForecast(scan.tick, pose, occupied))
        return found


class FastCoDrivingAgent(CoDrivingAgent):
    """As `codriving`, without the cap: as fast as the scenario asks and the road allows."""

    detector = f"{CODRIVING}:fast"
    cap = math.inf


class LoneCoDrivingAgent(CoDrivingAgent):
    """The twin of `codriving` that neither sends nor reads messages: same network, same planner, at most 5 m/s."""

    label = "single"
    detector = f"{CODRIVING}:alone"
    options: ClassVar[Mapping[str, Option]] = MappingProxyType({"score": OPTIONS["score"]})

    def _receive(self, messages: tuple[Message, ...]) -> tuple[Note, ...]:  # noqa: ARG002
        return ()

    def _share(self, scan: Scan) -> tuple[Message, ...]:  # noqa: ARG002
        return ()

    def _announce(self, seen: Observation, tracked: Objects) -> tuple[Message, ...]:  # noqa: ARG002
        return ()


class FastLoneCoDrivingAgent(LoneCoDrivingAgent):
    """As `codriving:alone`, without the cap."""

    detector = f"{CODRIVING}:fast-alone"
    cap = math.inf
