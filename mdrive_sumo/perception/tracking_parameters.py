"""Parameters of multi-object tracking, each with its unit and its reason."""

import math
from dataclasses import dataclass, replace

from mdrive_sumo.core.state import TICKS_PER_SECOND


@dataclass(frozen=True, slots=True)
class TrackingParameters:
    """Parameters of `ObjectTracker`. "Chosen": by driving the baselines in a sample of the Interaction bucket."""

    acceleration_sigma: float = 2.5
    """[m/s2] Of the white acceleration of the constant-velocity model: half to all of the largest usual acceleration
    (Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 6.3)."""
    turn_acceleration_sigma: float = 0.5
    """[rad/s2] The same for the yaw: a car enters a bend of a junction within about a second."""
    max_turn_rate: float = 0.8
    """[rad/s]"""
    gate: float = 9.21
    """Squared Mahalanobis distance of two dimensions that 99 % of the correct pairs have (chi-squared quantile)."""
    known_name_gate: float = 25.0
    """The same for a pair that the own sensor or the station named before: five standard deviations."""
    known_name_bonus: float = 4.0
    """Preference of a pair with a known name, in units of the gate: a hint and no proof."""
    min_gate_widths: float = 0.75
    """Positions within this share of the object's width are one object in any case: boxes do not overlap."""
    correlation_ticks: int = TICKS_PER_SECOND // 2
    """Errors of detections are correlated over half a second (docs/sensors.md): measurements that follow each other
    faster count for less."""
    confirmation_ticks: int = TICKS_PER_SECOND // 2 + 1
    """A standing object that was seen over this time is no false positive: those last half a second."""
    moving_speed: float = 1.0
    """[m/s] A faster object is no false positive either if it was seen twice."""
    lead_m: float = 12.0
    """A vehicle ahead in the own direction is believed at once if its centre is nearer than this, ..."""
    lead_lateral_m: float = 1.5
    """... less aside, ..."""
    lead_yaw: float = math.pi / 4
    """[rad] ... and turned by less: at a density of 0.5 in a circle of 100 m, one frame in 1700 has a false positive
    there, and a car in a queue that ignores the one ahead for half a second runs into it (decision 040)."""
    warm_ticks: int = TICKS_PER_SECOND
    """Objects of the first second are believed at once: in traffic a tracker has run before."""
    coasting_ticks: int = TICKS_PER_SECOND
    """An unseen moving object is predicted for this long."""
    standing_coasting_ticks: int = 2 * TICKS_PER_SECOND
    """An unseen standing object is kept for this long: detectors miss objects for half a second, also repeatedly."""
    tentative_ticks: int = TICKS_PER_SECOND // 2
    """An unseen object that is not confirmed is dropped after this time."""
    standstill_ticks: int = TICKS_PER_SECOND
    """An object that stayed at a place for this long stands there: its speed is 0, its position the mean."""
    standstill_count: int = 15
    """The mean is over about so many positions: 3 s, within which an estimated own position drifts little."""
    standstill_sigmas: float = 2.5
    """It stayed at the place while its position was within so many standard deviations of the mean, and ..."""
    standstill_m: float = 0.15
    """... this distance: an estimated own position drifts by 0.05 m a second."""
    standstill_speed_sigmas: float = 1.25
    """It stands only while its estimated speed, and the mean of that, is within so many standard deviations of 0."""
    standstill_speeds: float = 6.0
    """The mean of the estimated speed is over at most so many independent ones: one in `correlation_ticks`, for 3 s."""
    own_radius_m: float = 2.5
    """Reported vehicles nearer than this to the own centre are the own car."""
    memory_ticks: int = TICKS_PER_SECOND
    """Older messages are dropped."""
    never_ticks: int = 10**6
    """Age of a track that is to be dropped."""
    position_floor: float = 0.03
    """[m] Least standard deviation of a measured position: messages round to 1 cm, and motion models err."""
    yaw_floor: float = 0.01
    """[rad]"""
    speed_floor: float = 0.1
    """[m/s]"""
    size_weight: int = 20
    """Sizes are means over about so many measurements."""


TRACKING = TrackingParameters()
ETSI_TRACKING = replace(
    TRACKING,
    coasting_ticks=2 * TICKS_PER_SECOND + TICKS_PER_SECOND // 4,
    standing_coasting_ticks=3 * TICKS_PER_SECOND,
)
"""Under `--v2x-rate etsi` stations tell of an object once a second at least. One of these messages may be lost, and the
next take 250 ms to be used: until then the object is kept; a standing one while another is lost."""
