"""What comes back of a LiDAR's light: intensity by reflectivity, angle and distance; losses; echoes of rain.

docs/lidar-returns.md names the sources. Surrogates all: a beam has no width here, and no sensor was measured.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.sensing.lidar_cast import FACE_STEPS, MIDDLE, MOST_OWNERS, ROOF, HitKeys, unpack_keys
from mdrive_sumo.sensing.lidar_rays import Float32, LidarRays
from mdrive_sumo.sensing.lidar_reflectivity import Reflectivities

NOTHING = MOST_OWNERS - 1
"""Owner of a ray that hits nothing; 0 is the ground, then come the boxes, the buildings and the furniture."""
GRAZING = 0.42
"""Share of light that a surface seen along itself returns, of what it returns seen straight on, in the model of Oren
and Nayar (1994) for a source beside the eye: cos + B / A sin², A = 1 - 0.5 s² / (s² + 0.33), B = 0.45 s² / (s² + 0.09).
Their s, the spread of slopes, is chosen as 0.5 rad: B / A = 0.42. Laser scans are corrected by it (Tan and Cheng 2016).
"""
PLATE_LOW_M, PLATE_HIGH_M = 0.45, 0.57
"""[m] Edges of a plate: 120 mm high, and not below 0.3 m (Commission Regulation (EU) No 1003/2010)."""
NEAREST_DROP_M, FARTHER = 1.0, 0.9
"""[m] Drops are seen from 1 m to 1 m / (1 - 0.9), the fewer the farther, by the square: their echo falls so."""
LEVELS = 255
"""Intensities are bytes in sensors; their step hides the last digits of a reflectivity."""
SPREAD = 147.80
"""Standard deviation of the sum of four bytes, whose mean is 510: a nearly normal number."""


@dataclass(frozen=True, slots=True)
class LidarOptics:
    """How a sensor and the air treat light."""

    attenuation: float
    """Of intensity [1/m]: exp(-attenuation * distance)."""
    weak: float
    """[1/m²] A return of that intensity times the square of its distance is lost in every other case."""
    noise: float
    """Standard deviation of intensity as a share of it, in [0, 0.25]."""
    drops: int
    """Of 256 rays, how many meet a drop of rain nearby."""


CARLA_ATTENUATION = 0.004
"""[1/m] The formula's and default of CARLA's ray-cast LiDAR."""
WEAK = 0.1 / (50.0 * 50.0)
"""Pavement of reflectivity 0.1 is seen up to 50 m: Velodyne's data sheet of the HDL-64E."""
DRY = LidarOptics(CARLA_ATTENUATION, WEAK, 0.1, 0)
RAIN = LidarOptics(CARLA_ATTENUATION + 2 * 0.0027, WEAK, 0.1, 3)
"""35 mm/h: 0.0027 a metre, there and back (docs/detections.md). 1 % of the rays: the order of magnitude by Marshall and
Palmer's drops (1948), see docs/lidar-returns.md."""


def compute_ground_strengths(rays: LidarRays, keys: HitKeys, optics: LidarOptics) -> Float:
    """Return what bare ground (keys: its hits) of reflectivity 1 gives back by ray, in (0, 1]."""
    distance = (unpack_keys(keys)[0] * rays.stretch).astype(np.float64)
    return _compute_strengths(abs(rays.slope) / rays.stretch, distance, optics.attenuation)


def _compute_strengths(cosine: Float, distance: Float, attenuation: float) -> Float:
    """Return the intensities of reflectivity 1, by the cosine of the angle of incidence and the distance [m]."""
    return (cosine + GRAZING * (1.0 - cosine * cosine)) * portable.exp(-attenuation * distance)


@twin
def build_points(
    rays: LidarRays,
    keys: HitKeys,
    ground: Float,
    reflects: Reflectivities,
    optics: LidarOptics,
    height: float,
    luck: int,
    kept: Bool,
    noise_m: Float32,
    /,
) -> tuple[Float32, Int]:
    """Return the points (N, 4) of a scan as in `PointCloud`, and the owner of each (N,); that of a drop is the ground.

    keys: hits (rays,). ground: see `compute_ground_strengths`. height: of the sensor [m]. luck: start of the random
    numbers of this scan. kept: (rays,) mask of the rays that do not drop out, or empty. noise_m: (rays,) errors of
    distance [m], or empty.
    """
    across, owner, face = unpack_keys(keys)
    bits = draw_bits(luck, len(keys))
    is_used = kept if len(kept) else np.ones(len(keys), dtype=np.bool_)
    chance = (bits >> np.uint64(40)) * 2.0**-24
    sum_of_bytes = (
        (bits & 255) + (bits >> np.uint64(8) & 255) + (bits >> np.uint64(16) & 255) + (bits >> np.uint64(24) & 255)
    )
    distance = across * rays.stretch
    drop = NEAREST_DROP_M / (1.0 - FARTHER * chance)
    is_drop = is_used & ((bits >> np.uint64(32)) % 256 < optics.drops) & (drop < distance)
    rows = np.flatnonzero(is_used & ~is_drop & (owner != NOTHING))
    strength = ground[rows]
    solid = np.flatnonzero(owner[rows])
    on = rows[solid]
    is_roof = face[on] % MIDDLE == ROOF
    cosine = np.where(is_roof, abs(rays.slope[on]), face[on] % MIDDLE / FACE_STEPS) / rays.stretch[on]
    strength[solid] = _compute_strengths(cosine, distance[on].astype(np.float64), optics.attenuation)
    share = _find_reflectivities(owner[rows], face[rows], height + rays.slope[rows] * across[rows], reflects)
    light, far = share * strength, distance[rows].astype(np.float64)
    loss = optics.weak * (far * far)
    is_seen = chance[rows] * (light + loss) >= loss
    factor = 1.0 + optics.noise * ((sum_of_bytes[rows] - 510.0) / SPREAD)
    level = np.zeros(len(keys))
    level[rows] = np.clip(np.floor(LEVELS * (light * factor) + 0.5), 0.0, LEVELS)
    level[is_drop] = 1 + (bits[is_drop] & 7)
    distance[is_drop], owner = drop[is_drop], np.where(is_drop, 0, owner)
    if len(noise_m):
        distance = np.maximum(distance + noise_m, np.float32(0))
    taken = is_drop
    taken[rows[is_seen]] = True
    points = np.empty((np.count_nonzero(taken), 4), dtype=np.float32)
    np.multiply(rays.local[taken], distance[taken, None], out=points[:, :3])
    points[:, 3] = level[taken] / LEVELS
    return points, owner[taken]


def _find_reflectivities(owner: Int, face: Int, z: Float, reflects: Reflectivities) -> Float:
    """Return the reflectivities of hits at heights z [m] above the ground."""
    is_low = (face % MIDDLE == ROOF) | (z < reflects.split[owner])
    share = np.where(is_low, reflects.lower[owner], reflects.upper[owner])
    plate = reflects.plate[owner]
    is_plate = (face > MIDDLE) & (plate > 0) & (z >= PLATE_LOW_M) & (z < PLATE_HIGH_M)
    return np.where(is_plate, plate, share).astype(np.float64)


def draw_bits(luck: int, count: int) -> npt.NDArray[np.uint64]:
    """Return 64 random bits for each of the counted, by SplitMix64 (Steele, Lea and Flood 2014): counter-based."""
    state = np.uint64(luck) + np.arange(1, count + 1, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    state = (state ^ state >> np.uint64(30)) * np.uint64(0xBF58476D1CE4E5B9)
    state = (state ^ state >> np.uint64(27)) * np.uint64(0x94D049BB133111EB)
    return state ^ state >> np.uint64(31)
