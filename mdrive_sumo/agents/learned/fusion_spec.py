"""Grids, classes and names of learned detectors that share features; training and driving read the same facts.

All grids are in the frame of the car that made them: x ahead, y left of the box centre. Row 0 is ahead, column 0 left,
and the car stands in the middle.
"""

from mdrive_sumo.core.errors import InputError

GRID_VERSION = 1
"""Raised when cells, layers or features of earlier versions mean something else."""
GRID_CELLS, GRID_CELL_M = 256, 0.4
"""The point grid: 256 x 256 cells of 0.4 m, a quarter of a car's length."""
GRID_REACH_M = GRID_CELLS * GRID_CELL_M / 2
"""[m] From the car to the edges of all grids: 51.2."""
LAYER_EDGES_M = (0.3, 0.7, 1.1, 1.6, 2.0, 2.8, 4.0)
"""[m above the ground] Between the height layers. Below 0.3 is the ground and its range noise; assumed roofs
(`sensing.lidar_world`) are at 1.5 (cars), 1.75 (people and cyclists), 2.2 (vans) and 3.4 (trucks), each in a layer of
its own; what is above 4.0 is a building or a tree."""
GRID_LAYERS = len(LAYER_EDGES_M) + 1
MAX_COUNT = 255
"""Points counted in a cell: the range of a byte."""

FEATURE_CHANNELS = 16
FEATURE_CELLS, FEATURE_CELL_M = 64, 1.6
"""Maps of features: a cell is 4 x 4 cells of the point grid."""
TILE_CELLS = 8
"""Edge of a tile in cells of features: 12.8 m. A message carries whole tiles."""
TILE_ROWS = FEATURE_CELLS // TILE_CELLS
MAX_CAVS = 5
"""Of one frame: the own car and four senders."""
DELAYS_TICKS = (0, 2, 4, 6)
"""Ages of a sender's scan that frames hold: 0 to 300 ms, as a LiDAR of 10 Hz gives them."""

MAP_TICKS = 4
"""A scan is encoded and shared at 5 Hz, the rate at which the paper's agents decide; 10 Hz, the LiDAR's rate, would
take twice the time and the bytes."""
WAIT_TICKS = 2
"""A scan is fused 100 ms after it was made: by then maps of the same scan have arrived over the channels `ideal` and
`realistic`. It is also the latency of the surrogates' detections. `none` waits as long, so that all are as late."""
MAX_AGE_TICKS = DELAYS_TICKS[-1]
"""Maps that are older than the own scan by more are dropped: no detector was trained on them."""
LEAST_CONFIDENCE = 0.01
"""Tiles stay out if the sender takes it for less probable that a road user is there, in each of their cells."""
MAP_PACKETS = 2
"""Packets of a map. With CAMs, 18 kB a second of the 22.5 that `realistic` grants, headers included; and 142 of the
200 ms between two maps, after which congestion control of an empty road lets them go over ITS-G5 (docs/radio.md)."""

OUTPUT_CELLS, OUTPUT_CELL_M = 128, 0.8
"""Maps of the detection head."""
CLASSES = ("vehicle", "rider", "pedestrian")
"""Cars, vans, trucks and buses; cyclists and motorcycles; people on foot. Props are no targets."""
BOX_NUMBERS = 7
"""Of a cell: dx, dy [m, from its centre], log length, log width [of metres], cos and sin of twice the yaw, and a number
that is positive where the heading lies within 90 degrees of 45 degrees to the left. A box of points looks the same from
both ends, so its axis is certain where its heading is not."""

FUSIONS = ("attfuse", "disconet", "fcooper", "cobevt")
"""What fuses features of several cars."""
BOUNDS = ("none", "late", "early")
"""No sharing; boxes are shared; cells of the point grid are shared."""
CODRIVING = "codriving"
"""The counterpart of CoDriving: `attfuse` with a forecast of occupancy, on which a planner drives."""
SHARING = (*FUSIONS, CODRIVING)
"""What gets features of several cars."""
FORECAST_S = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0)
"""[s] After the scan: times of the maps of occupancy, in cells of the detection head."""
TRAINED = ("none", "early", *SHARING)
"""Detectors with weights. `late` merges the boxes of `none`."""


def check_detector(name: str) -> None:
    """Raise InputError unless a detector of this name has weights."""
    if name not in TRAINED:
        raise InputError(f"detector {name!r}: expected one of {', '.join(TRAINED)}, found none of that name")
