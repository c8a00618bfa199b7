"""`perception-swap:*`: the paper's rule-based planner behind trained detectors that share what they see, or do not."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from mdrive_sumo.agents.learned.box_decoding import MAX_IOU, DetectedBoxes
from mdrive_sumo.agents.learned.detection_tracker import TRACK_ERRORS, DetectionTracker
from mdrive_sumo.agents.learned.feature_inbox import FeatureInbox, ReceivedMap
from mdrive_sumo.agents.learned.fusion_network import EncodedScan, load_detector
from mdrive_sumo.agents.learned.fusion_spec import (
    FEATURE_CELLS,
    GRID_REACH_M,
    LEAST_CONFIDENCE,
    MAP_PACKETS,
    MAP_TICKS,
    WAIT_TICKS,
)
from mdrive_sumo.agents.learned.network_inputs import LIDAR_ID
from mdrive_sumo.agents.learned.point_grid import Cells, build_point_cells, merge_cells
from mdrive_sumo.agents.learned.shared_grids import (
    POINT_GRID,
    build_feature_grid,
    encode_features,
    encode_points,
    limit_features,
    read_points,
)
from mdrive_sumo.contract import (
    Briefing,
    Detections,
    Message,
    Note,
    Objects,
    Observation,
    OwnState,
    Plan,
    PointCloud,
    Reply,
    SensorSpec,
)
from mdrive_sumo.contract.agent_options import Choice, Config, Option, read_choice, read_options
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.onnx_weights import check_runtime
from mdrive_sumo.perception.box_iou import compute_ious
from mdrive_sumo.perception.late_fusion import ETSI_FUSION, FUSION, OPV2V_LIMITS, LateFusion
from mdrive_sumo.planning.hazard_rule import HazardRulePlanner
from mdrive_sumo.v2x.awareness_service import AwarenessService
from mdrive_sumo.v2x.content import MAX_PACKET_BYTES
from mdrive_sumo.v2x.messages import CPM, ReferencePose

OPTIONS: Mapping[str, Option] = MappingProxyType(
    {
        "budget": Option(MAP_PACKETS * MAX_PACKET_BYTES, 200, 60 * MAX_PACKET_BYTES),
        "score": Option(0.4, 0.1, 1.0),
    }
)
PROVIDERS = Choice("auto", ("auto", "cpu"))


@dataclass(frozen=True, slots=True)
class Scan:
    """A scan that waits to be fused."""

    tick: int
    own: OwnState
    """Where the car took itself to be."""
    cells: Cells
    encoded: EncodedScan | None
    """None if the network is to see the cells of all cars."""

    def build_pose(self) -> ReferencePose:
        """Return the pose of messages about it."""
        own = self.own
        return ReferencePose(own.x, own.y, own.yaw, self.tick, own.position_sigma, own.yaw_sigma)


class Planner(Protocol):
    """Drives by the objects that a car knows."""

    def plan(self, seen: Observation, objects: Objects) -> tuple[Plan, tuple[Note, ...]]:
        """Return the plan of this tick, and notes of why; objects are in the world frame at its time."""
        ...


class DetectorAgent:
    """A car with one LiDAR and a trained detector: encodes and shares its scans, fuses, tracks, drives by hazard rule.

    Options: `weights` (path to NAME.onnx or NAME.json of a training of your own, with NAME-encoder beside it; else the
    packaged ones), `provider` (`auto`: a GPU if ONNX Runtime can use one; `cpu`), `score` (less certain boxes are no
    objects), `budget` (bytes of a map; of detectors that share features).
    """

    label = "sharing"
    family: ClassVar[str] = "perception-swap:"
    detector: ClassVar[str]
    """What follows `family` in its name."""
    weights: ClassVar[str]
    """Key in `fusion_spec.TRAINED`."""
    options: ClassVar[Mapping[str, Option]] = MappingProxyType({"score": OPTIONS["score"]})

    def __init__(self, config: Config) -> None:
        """Read the options and load the networks. Raises InputError."""
        name = self.family + self.detector
        self._numbers = read_options(name, config, self.options, {"provider": PROVIDERS, "weights": Choice("", ())})
        use_gpu = read_choice(name, config, "provider", PROVIDERS) == "auto"
        folder = _read_weights_folder(name, config, self.weights)
        check_runtime(name)
        self._network = load_detector(self.weights, folder, use_gpu)

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Return the LiDAR."""
        return (SensorSpec("lidar", LIDAR_ID, options={"profile": "lmdrive", "every_ticks": MAP_TICKS}),)

    def start(self, briefing: Briefing) -> None:
        """Prepare receiving, tracking and planning; nothing is left of an earlier episode."""
        self._briefing = briefing
        self._tracker = DetectionTracker()
        self._planner = self._build_planner(briefing)
        self._waiting: Scan | None = None

    def _build_planner(self, briefing: Briefing) -> Planner:
        return HazardRulePlanner(briefing)

    def act(self, seen: Observation) -> Reply:
        """Return the plan of this tick, and what is shared of a new scan."""
        notes = self._receive(seen.messages)
        has_looked = self._waiting is not None and seen.tick >= self._waiting.tick + WAIT_TICKS
        if self._waiting is not None and has_looked:
            self._detect(self._waiting)
            self._waiting = None
        messages: tuple[Message, ...] = ()
        if LIDAR_ID in seen.lidar:
            self._waiting = self._encode(seen.tick, seen.own, seen.lidar[LIDAR_ID])
            messages = self._share(self._waiting)
        tracked = self._tracker.predict(seen.tick)
        messages = self._announce(seen, tracked) + messages
        objects = self._add_reported(seen, tracked)
        plan, reasons = self._planner.plan(seen, objects)
        detections = Detections.from_objects(objects) if has_looked else None
        return Reply(plan=plan, messages=messages, notes=notes + reasons, detections=detections)

    def _detect(self, scan: Scan) -> None:
        found = self._look(scan)
        size = self._briefing.vehicle.length, self._briefing.vehicle.width
        # Others see the own car, too: bodies do not overlap, so what overlaps it is the car itself.
        overlaps = compute_ious(found.boxes, np.array(((0.0, 0.0, 0.0, *size),)))[:, 0] > MAX_IOU
        kept = (found.scores >= self._numbers["score"]) & ~overlaps
        self._tracker.update(
            scan.tick, scan.own, DetectedBoxes(found.boxes[kept], found.classes[kept], found.scores[kept])
        )

    def _encode(self, tick: int, own: OwnState, cloud: PointCloud) -> Scan:
        cells = build_point_cells(cloud.points)
        return Scan(tick, own, cells, self._network.encode(cells))

    def _look(self, scan: Scan) -> DetectedBoxes:
        """Return what the network finds in a scan and in what has arrived by now."""
        assert scan.encoded is not None
        return self._network.detect(scan.encoded.features[None])

    def _receive(self, messages: tuple[Message, ...]) -> tuple[Note, ...]:  # noqa: ARG002
        """Store what others share; return notes about what cannot be used."""
        return ()

    def _share(self, scan: Scan) -> tuple[Message, ...]:  # noqa: ARG002
        """Return the messages about a new scan."""
        return ()

    def _announce(self, seen: Observation, tracked: Objects) -> tuple[Message, ...]:  # noqa: ARG002
        """Return the messages that are due without a scan."""
        return ()

    def _add_reported(self, seen: Observation, tracked: Objects) -> Objects:  # noqa: ARG002
        """Return the own objects and those that others report."""
        return tracked


class LoneDetectorAgent(DetectorAgent):
    """The paper's rule-based planner behind a trained detector of the own scans: a bound, it shares nothing."""

    label = "single"
    detector = weights = "none"


class AnnouncingDetectorAgent(DetectorAgent):
    """A detector that shares: its car is a station, which sends CAMs."""

    shares_objects: ClassVar[bool] = False

    def start(self, briefing: Briefing) -> None:
        """Prepare sending, too."""
        super().start(briefing)
        self._awareness = AwarenessService(briefing, GRID_REACH_M, TRACK_ERRORS, self.shares_objects)

    def _announce(self, seen: Observation, tracked: Objects) -> tuple[Message, ...]:
        return self._awareness.compose_messages(replace(seen, objects=tracked))


class LateSharingAgent(AnnouncingDetectorAgent):
    """The paper's rule-based planner behind the boxes that the trained detectors of several cars find: late fusion.

    Each car tracks what it finds in its own scans, sends the tracks as CPMs, and merges those of others.
    """

    detector, weights = "late", "none"
    shares_objects = True

    def start(self, briefing: Briefing) -> None:
        """Prepare merging, too."""
        super().start(briefing)
        accumulates = briefing.v2x_rate == "etsi"
        self._fusion = LateFusion(briefing.vehicle, OPV2V_LIMITS, ETSI_FUSION if accumulates else FUSION, accumulates)

    def _receive(self, messages: tuple[Message, ...]) -> tuple[Note, ...]:
        return self._fusion.receive(message for message in messages if message.type == CPM)

    def _add_reported(self, seen: Observation, tracked: Objects) -> Objects:
        return self._fusion.fuse(seen.tick, seen.own, tracked)


class FeatureSharingAgent(AnnouncingDetectorAgent):
    """A detector that fuses the features of several cars."""

    options: ClassVar[Mapping[str, Option]] = OPTIONS

    def __init__(self, config: Config) -> None:
        """Read the options and load the networks. Raises InputError."""
        super().__init__(config)
        self._grid = build_feature_grid(self._network)

    def start(self, briefing: Briefing) -> None:
        """Prepare the inbox, too."""
        super().start(briefing)
        self._inbox = FeatureInbox(self._grid, OPV2V_LIMITS)

    def _receive(self, messages: tuple[Message, ...]) -> tuple[Note, ...]:
        return self._inbox.receive(messages)

    def _share(self, scan: Scan) -> tuple[Message, ...]:
        assert scan.encoded is not None
        budget = self._numbers["budget"]
        return encode_features(scan.encoded, scan.build_pose(), self._grid, budget, LEAST_CONFIDENCE)

    def _look(self, scan: Scan) -> DetectedBoxes:
        assert scan.encoded is not None
        return self._network.detect(*stack_maps(scan.encoded, self._inbox.collect(scan.tick, scan.own)))


class EarlySharingAgent(AnnouncingDetectorAgent):
    """The paper's rule-based planner behind a trained detector of the points of several cars: early fusion, a bound.

    Its messages are lossless and have no budget: they need a channel without limits.
    """

    detector = weights = "early"

    def start(self, briefing: Briefing) -> None:
        """Prepare the inbox, too."""
        super().start(briefing)
        self._inbox = FeatureInbox(POINT_GRID, OPV2V_LIMITS)

    def _receive(self, messages: tuple[Message, ...]) -> tuple[Note, ...]:
        return self._inbox.receive(messages)

    def _encode(self, tick: int, own: OwnState, cloud: PointCloud) -> Scan:
        return Scan(tick, own, build_point_cells(cloud.points), None)

    def _share(self, scan: Scan) -> tuple[Message, ...]:
        return encode_points(scan.cells, scan.build_pose())

    def _look(self, scan: Scan) -> DetectedBoxes:
        received = self._inbox.collect(scan.tick, scan.own)
        poses = np.array([(0.0, 0.0, 0.0), *(one.pose for one in received)])
        merged = merge_cells([scan.cells, *(read_points(one.map) for one in received)], poses)
        return self._network.detect(self._network.encode(merged).features[None])


class FusedMaps(NamedTuple):
    """The own map and those of others, as a fusion takes them; see `FusionDetector.detect`."""

    features: npt.NDArray[np.float32]
    arrived: npt.NDArray[np.float32]
    pose: npt.NDArray[np.float32]
    age: npt.NDArray[np.float32]


def stack_maps(own: EncodedScan, received: list[ReceivedMap]) -> FusedMaps:
    """Return the own map and those of others; the own one comes first."""
    cells = (FEATURE_CELLS, FEATURE_CELLS)
    features = np.stack([own.features, *(limit_features(one.map.features) for one in received)])
    arrived = np.stack([np.ones(cells, np.float32), *(one.map.arrived.astype(np.float32) for one in received)])
    pose = np.stack([np.zeros(3, np.float32), *(one.pose for one in received)])
    age = np.array([0.0, *(one.age_s for one in received)], dtype=np.float32)
    return FusedMaps(features, arrived, pose, age)


def _read_weights_folder(agent: str, config: Config, weights: str) -> Path | None:
    """Return the folder of the files that the option `weights` names, None if it is not given. Raises InputError."""
    value = config.get("weights", "")
    if value == "":
        return None
    files = f"{weights}.onnx", f"{weights}.json"
    if not isinstance(value, str) or Path(value).name not in files:
        raise InputError(
            f"agent {agent}: option weights: expected the path of {' or '.join(files)}, with {weights}-encoder.onnx"
            f" beside it, found {value!r}"
        )
    return Path(value).parent


class AttFuseAgent(FeatureSharingAgent):
    """The paper's rule-based planner behind a trained detector that fuses by attention, after AttFuse."""

    detector = weights = "attfuse"


class DiscoNetAgent(FeatureSharingAgent):
    """The paper's rule-based planner behind a trained detector that fuses by a graph of cars, after DiscoNet."""

    detector = weights = "disconet"


class FCooperAgent(FeatureSharingAgent):
    """The paper's rule-based planner behind a trained detector that takes the largest features, after F-Cooper."""

    detector = weights = "fcooper"


class CoBevtAgent(FeatureSharingAgent):
    """The paper's rule-based planner behind a trained detector that fuses by sparse axial attention, after CoBEVT."""

    detector = weights = "cobevt"
