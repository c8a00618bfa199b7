"""Sensing profiles: how well all CAVs and road-side units of an episode sense."""

from enum import StrEnum, auto

from mdrive_sumo.contract.detector_profiles import IDEAL, LIDAR_SINGLE


class SensingProfile(StrEnum):
    """Quality of own states and detections, the same for every CAV and road-side unit of an episode."""

    REALISTIC = auto()
    """Own states are estimates, and the standard detector has the errors of a published one."""
    PERFECT = auto()
    """No noise anywhere; what is hidden remains hidden."""

    @property
    def standard_detector(self) -> str:
        """The detector profile that the name `standard` stands for."""
        return LIDAR_SINGLE if self is SensingProfile.REALISTIC else IDEAL
