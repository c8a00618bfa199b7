"""Cooperative awareness, collective perception and warnings of a CAV (ETSI EN 302 637-2, TS 103 324, EN 302 637-3)."""

from dataclasses import replace

import numpy as np

from mdrive_sumo.contract import Briefing, Message, Objects, Observation
from mdrive_sumo.contract.detector_profiles import IDEAL, PROFILES, DetectionProfile
from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Float, Int
from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.v2x.content import MAX_PACKET_BYTES
from mdrive_sumo.v2x.encoding import CPM_BYTES, HEADER_BYTES, OBJECT_BYTES
from mdrive_sumo.v2x.messages import MAX_OBJECTS, MAX_SECTORS, MESSAGE_REACH_M, Cam, Cpm, Denm, ReferencePose, encode
from mdrive_sumo.v2x.services.cam_rule import CamRule, StationMotion
from mdrive_sumo.v2x.services.cpm_rule import CpmRule, DueCpm
from mdrive_sumo.v2x.services.denm_rule import DenmRule, SenderFacts
from mdrive_sumo.v2x.services.hazard_detector import HazardDetector

INTERVAL_TICKS = TICKS_PER_SECOND // 10
"""CAMs and CPMs are sent at 10 Hz, the fastest that ETSI allows (EN 302 637-2, TS 103 324)."""
PATH_STEP_M, PATH_POINTS, PATH_REACH_M = 10.0, 23, 300.0
"""[m] The path history of a CAM has a point for every so many metres, at most so many: the last 230 m, within what a
message can carry. Ours; profiles of series cars ask for 200 m at least."""


class AwarenessService:
    """Composes the CAMs, CPMs and DENMs of one CAV, when the sending rate of the episode says (`Briefing.v2x_rate`).

    `fixed`: a CAM and a CPM in every interval of 100 ms, no DENM. `etsi`: by the rules in `v2x.services`, which are
    checked in the same intervals.
    """

    def __init__(
        self,
        briefing: Briefing,
        range_m: float,
        detector: str | DetectionProfile = IDEAL,
        shares_objects: bool = True,
    ) -> None:
        """Configure the service.

        detector: error profile of the own detections, or its name; it states their age and errors. shares_objects:
        whether there are CPMs; a CAV that shares something else than objects has none.
        """
        self._vehicle, self._range, self._shares_objects = briefing.vehicle, range_m, shares_objects
        self._profile = PROFILES[detector] if isinstance(detector, str) else detector
        self._due_tick = 0
        self._services = None if briefing.v2x_rate == "fixed" else _EtsiServices(briefing, self._profile)

    def compose_messages(self, observation: Observation) -> tuple[Message, ...]:
        """Return the messages of this tick; a CAV without observation in the due tick sends with its next one."""
        if observation.tick < self._due_tick or observation.objects is None:
            return ()
        self.postpone(observation.tick)
        own = observation.own
        pose = ReferencePose(own.x, own.y, own.yaw, observation.tick, own.position_sigma, own.yaw_sigma)
        size = self._vehicle.length, self._vehicle.width
        cam = Cam(pose, own.speed, own.acceleration, own.yaw_rate, *size, own.speed_sigma)
        objects = _select_objects(observation.objects, own.x, own.y)
        if self._services is None:
            cpms = (encode(build_cpm(pose, self._range, objects, self._profile)),) if self._shares_objects else ()
            return encode(cam), *cpms
        contents: list[Cam | Cpm | Denm] = []
        if (due_cam := self._services.check_cam(cam)) is not None:
            contents.append(due_cam)
        due = self._services.cpm_rule.check(pose.tick, objects, count_fitting_objects(objects))
        if due is not None and self._shares_objects:
            contents.append(build_cpm(pose, self._range, take_due(objects, due), self._profile))
        contents += self._services.check_denms(observation, cam, objects)
        return tuple(encode(content) for content in contents)

    def postpone(self, tick: int) -> None:
        """Wait for the next interval: the messages of this one have been sent in `tick`, also by another service."""
        self._due_tick = tick - tick % INTERVAL_TICKS + INTERVAL_TICKS


class _EtsiServices:
    """The rules of ETSI's services for one CAV, and what they remember."""

    def __init__(self, briefing: Briefing, profile: DetectionProfile) -> None:
        self.cpm_rule = CpmRule(profile)
        self._cam_rule, self._denm_rule = CamRule(), DenmRule()
        self._hazards = HazardDetector(briefing)
        self._path: list[tuple[float, float]] = []
        """Former places [m], the latest last."""

    def check_cam(self, cam: Cam) -> Cam | None:
        """Return the CAM that is to be sent, None if none is due."""
        pose = cam.pose
        due = self._cam_rule.check(pose.tick, StationMotion(pose.x, pose.y, pose.yaw, cam.speed))
        place, path = (pose.x, pose.y), self._path
        if not path or portable.hypot(path[-1][0] - pose.x, path[-1][1] - pose.y) >= PATH_STEP_M:
            self._path = [*path, place][-PATH_POINTS:]
        if due is None or not due.has_low_frequency:
            return due and cam
        former = [one for one in path[::-1] if portable.distance(one, place) < PATH_REACH_M]
        return replace(cam, path_history=np.array(former, dtype=np.float64).reshape(-1, 2))

    def check_denms(self, observation: Observation, cam: Cam, objects: Objects) -> list[Denm]:
        """Return the DENMs that are to be sent. Call it after the CPM, which knows what is no false positive."""
        hazards = self._hazards.detect(observation, objects.take(self.cpm_rule.find_confirmed(objects)))
        sender = SenderFacts(cam.pose, cam.speed, cam.length, cam.width)
        return self._denm_rule.check(observation.tick, sender, hazards)


def count_fitting_objects(objects: Objects) -> int:
    """Return the number of objects that fit into one packet with the free sight that these have."""
    free_bytes = MAX_PACKET_BYTES - HEADER_BYTES - CPM_BYTES - len(objects.free_m)
    return min(free_bytes // OBJECT_BYTES, MAX_OBJECTS)


def take_due(objects: Objects, due: DueCpm) -> Objects:
    """Return the objects of a CPM that is due, the most useful first, with the free sight if it is due as well."""
    taken = objects.take(due.rows)
    return taken if due.has_sensor_information else replace(taken, free_m=np.zeros(0))


def build_cpm(
    pose: ReferencePose, range_m: float, objects: Objects, profile: DetectionProfile, roadside: bool = False
) -> Cpm:
    """Return the CPM of a station at that pose with detections of that profile, their age and standard deviations."""
    sigmas = compute_sigmas(profile, pose, objects.x, objects.y)
    age = np.full(len(objects.ids), profile.latency_ticks, dtype=np.uint8)
    return Cpm(pose, range_m, objects, age, roadside, sigmas)


@twin
def compute_sigmas(profile: DetectionProfile, pose: ReferencePose, x: Float, y: Float, /) -> Float:
    """Return the standard deviations (N, 3) that a CPM states of detections at x, y (N,) [m], see `Cpm.sigmas`."""
    sigmas = np.empty((len(x), 3))
    sigmas[:, 0] = profile.spread_at(portable.hypot(x - pose.x, y - pose.y))
    sigmas[:, 1], sigmas[:, 2] = profile.yaw_sigma, profile.speed_sigma
    return sigmas


def _select_objects(objects: Objects, x: float, y: float) -> Objects:
    """Return the nearest objects, as many as a message can carry."""
    assert len(objects.free_m) <= MAX_SECTORS, "the sensor's option free_space is bounded"
    rows = find_rows_within(objects.x, objects.y, x, y, MESSAGE_REACH_M / 2)
    return objects if len(objects) == len(rows) <= MAX_OBJECTS else objects.take(rows[:MAX_OBJECTS])


@twin
def find_rows_within(x: Float, y: Float, centre_x: float, centre_y: float, reach_m: float, /) -> Int:
    """Return the rows of places x, y (N,) [m] nearer than reach_m to a centre, along and across the axes."""
    return np.flatnonzero(np.maximum(np.abs(x - centre_x), np.abs(y - centre_y)) < reach_m)
