"""`perception-swap:*:profile`: the paper's rule planner behind a surrogate of a cooperative detector's quality.

The cooperative detector is not run: every CAV has detections as good as the detector's published ones, and the CAVs
exchange them as CPMs besides. `learned.detector_agent` has the agents that run detectors.
"""

from mdrive_sumo.contract import Briefing, Observation, Reply, SensorSpec
from mdrive_sumo.contract.agent_options import Config, read_options
from mdrive_sumo.perception.late_fusion import ETSI_FUSION, FUSION, OPV2V_LIMITS, LateFusion
from mdrive_sumo.planning.hazard_rule import HazardRulePlanner
from mdrive_sumo.v2x.awareness_service import AwarenessService
from mdrive_sumo.v2x.messages import CPM

RANGE_M = 80.0
"""[m] Of the detector."""


class ProfileSwapAgent:
    """Surrogate of a detector: detections with the errors of its published precision, and CPMs of them."""

    label = "sharing"
    detector = "ideal"

    def __init__(self, config: Config) -> None:
        read_options(f"perception-swap:{self.detector}:profile", config, {})

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Return the sensor of boxes as the detector finds them."""
        return (SensorSpec("objects", range_m=RANGE_M, options={"profile": self.detector}),)

    def start(self, briefing: Briefing) -> None:
        """Prepare fusion, sending and planning."""
        accumulates = briefing.v2x_rate == "etsi"
        self._fusion = LateFusion(briefing.vehicle, OPV2V_LIMITS, ETSI_FUSION if accumulates else FUSION, accumulates)
        self._awareness = AwarenessService(briefing, RANGE_M, self.detector)
        self._planner = HazardRulePlanner(briefing)

    def act(self, seen: Observation) -> Reply:
        """Return a plan that drives along the route at full speed, or stands."""
        assert seen.objects is not None, "the objects sensor is declared"
        unreadable = self._fusion.receive(message for message in seen.messages if message.type == CPM)
        objects = self._fusion.fuse(seen.tick, seen.own, seen.objects)
        plan, reasons = self._planner.plan(seen, objects)
        return Reply(plan=plan, messages=self._awareness.compose_messages(seen), notes=unreadable + reasons)


class AttFuseProfileAgent(ProfileSwapAgent):
    """Surrogate: AttFuse's detection quality on one vehicle, with CARLA BasicAgent's hazard rule."""

    detector = "attfuse"


class DiscoNetProfileAgent(ProfileSwapAgent):
    """Surrogate: DiscoNet's detection quality on one vehicle, with CARLA BasicAgent's hazard rule."""

    detector = "disconet"


class FCooperProfileAgent(ProfileSwapAgent):
    """Surrogate: F-Cooper's detection quality on one vehicle, with CARLA BasicAgent's hazard rule."""

    detector = "fcooper"


class CoBevtProfileAgent(ProfileSwapAgent):
    """Surrogate: CoBEVT's detection quality on one vehicle, with CARLA BasicAgent's hazard rule."""

    detector = "cobevt"
