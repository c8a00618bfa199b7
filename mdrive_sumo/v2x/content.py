"""Contents of V2X messages as values in the world frame: SI units, box centres. Read `messages` first."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from functools import lru_cache
from types import MappingProxyType
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from mdrive_sumo.contract import Objects
from mdrive_sumo.core.geometry import Float

CAM, CPM, MCM, DENM, FEATURE, TEXT = "cam", "cpm", "mcm", "denm", "feature", "text"
TYPES = (CAM, CPM, MCM, DENM, FEATURE, TEXT)
FLOOD = "(flood)"
"""Type of an attacker's useless bytes, which no agent can use and no agent reads."""
MAX_OBJECTS, MAX_SECTORS, MAX_POINTS, MAX_NAMES = 255, 255, 100, 32
MAX_PATH_POINTS = 40
"""Points of a path history at most (ETSI TS 102 894-2, PathHistory)."""
MAX_PACKET_BYTES = 1398
"""Payload of one GeoNetworking packet at most [bytes] (ETSI EN 302 636-4-1, itsGnMaxSduSize)."""
MAX_NAME_BYTES = 80
"""Bytes of a name in UTF-8: ids of scenarios have at most 80 characters (`scenario_part.Identifier`)."""
MAX_TEXT_BYTES = 8192
MAX_TILES, MAX_CHANNELS, MAX_TILE_CELLS, MAX_LEVEL = 255, 64, 16, 255
"""Of a `Feature`: tiles, channels, cells along the edge of a tile, and the largest quantised value, either sign."""
MAX_TILE_VALUES = 2**18
"""Values in the tiles of one `Feature` at most, zeros included (256 tiles of 16 x 8 x 8): few bytes can stand for many
zeros, and receivers expand them."""
MAX_PAYLOAD_BYTES = 65535
"""Bytes of a message of a type that is the agents' own."""
MESSAGE_REACH_M = 327.67
"""How far from the sender's pose a message can place something, along and across [m]."""
MAX_PLACE_M = 990_000.0
"""[m] x and y of a sender's pose at most: an agent that believes its message detects something there, and detections
lie within 1000 km of the origin (`contract.reply_check`)."""


class MessageError(ValueError):
    """Invalid bytes for a message type, or contents that a message cannot carry."""


class Intention(IntEnum):
    """Intended change of speed of a CAV (protocol 10.2)."""

    STOP = 0
    SLOWER = 1
    KEEP = 2
    FASTER = 3


class Direction(IntEnum):
    """Intended direction of a CAV (protocol 10.2)."""

    FOLLOW = 0
    LEFT = 1
    RIGHT = 2
    STRAIGHT = 3
    CHANGE_LEFT = 4
    CHANGE_RIGHT = 5


class EventCause(IntEnum):
    """What a DENM warns of: cause codes of ETSI TS 102 894-2."""

    STATIONARY_VEHICLE = 94
    """The sender stands where others drive."""
    COLLISION_RISK = 97
    """The sender is about to collide."""
    DANGEROUS_SITUATION = 99
    """The sender brakes as hard as it can (sub cause 1: the electronic emergency brake is engaged)."""


class Termination(IntEnum):
    """Whether a DENM ends its event (EN 302 637-3)."""

    NONE = 0
    CANCELLATION = 1
    """The station that detected the event says that it is over."""


@dataclass(frozen=True, slots=True)
class ReferencePose:
    """The sender's reference pose [m, rad] as the sender estimates it, its tick, and how uncertain it is."""

    x: float
    """x of the box centre in the world frame [m]."""
    y: float
    """y of the box centre in the world frame [m]."""
    yaw: float
    """Heading [rad], counter-clockwise from +x."""
    tick: int
    """When the sender had this pose."""
    position_sigma: float = 0.0
    """Standard deviation of the errors of x and of y [m]."""
    yaw_sigma: float = 0.0
    """Standard deviation of the error of yaw [rad]."""


@dataclass(frozen=True, slots=True)
class Cam:
    """Cooperative awareness message: pose, motion and size of the sender."""

    pose: ReferencePose
    """Where the sender is."""
    speed: float
    """Along the heading [m/s]."""
    acceleration: float
    """Along the heading [m/s2]."""
    yaw_rate: float
    """[rad/s], positive to the left."""
    length: float
    """Length of the box [m]."""
    width: float
    """Width of the box [m]."""
    speed_sigma: float = 0.0
    """Standard deviation of the error of the speed [m/s]."""
    path_history: Float | None = None
    """(K, 2) former places [m], the latest first: the low-frequency container; None: the CAM has none."""


@dataclass(frozen=True, slots=True)
class Cpm:
    """Collective perception message: detections and free sight of the sender."""

    pose: ReferencePose
    """Where the sender is."""
    range_m: float
    """How far its sensor reaches [m]."""
    objects: Objects
    """Track names are the sender's own; `free_m` is its free sight in equal sectors, see `Objects`."""
    age: npt.NDArray[np.uint8]
    """(N,) ticks since each object was measured, at the tick of the pose."""
    roadside: bool = False
    """Whether the sender is a road-side unit, which has no box of its own."""
    sigmas: Float = field(default_factory=lambda: np.zeros((0, 3)))
    """(N, 3) standard deviations of the measurements relative to the sender: of each position coordinate [m], of yaw
    [rad] and of speed [m/s]; no rows: not stated, received as 0."""


@dataclass(frozen=True, slots=True)
class Mcm:
    """Manoeuvre coordination message: planned and desired trajectory, requests to other stations, and answers."""

    pose: ReferencePose
    """Where the sender is."""
    speed: float
    """Along the heading [m/s]."""
    intention: Intention
    """What the sender does with its speed."""
    direction: Direction
    """Where the sender goes."""
    interval_s: float
    """Time [s] between the points of the trajectories; the first point lies one interval after the pose's tick."""
    planned: Float
    """(K, 2) box centres [m] that the sender plans to follow."""
    desired: Float = field(default_factory=lambda: np.zeros((0, 2)))
    """(K, 2) box centres [m] without the constraints of other stations; empty: the same as planned."""
    requests: Mapping[str, Intention] = field(default_factory=lambda: MappingProxyType({}))
    """Requested intention by station id; the entry of the sender's own id is its commitment."""
    answers: Mapping[str, bool] = field(default_factory=lambda: MappingProxyType({}))
    """Whether the sender accepts the last request of each station, by its id. A sender that accepts its own request
    has agreed with the others on an order of passing: its group."""
    group: tuple[str, ...] = ()
    """Ids of the conflict group of the sender, itself included: in an agreed order of passing, else sorted."""
    until_tick: int = 0
    """Tick until which the requests are valid."""


@dataclass(frozen=True, slots=True)
class Denm:
    """Decentralised environmental notification message: an event, and the motion of the sender.

    Sender and `sequence` together name the event (the action id of ETSI EN 302 637-3); repetitions have the same.
    """

    pose: ReferencePose
    """Where the sender is, at the reference time: when this content was made. Repetitions have new ones."""
    sequence: int
    """Number of the event among those of its sender, 0 to 65535."""
    cause: EventCause
    """What has happened."""
    sub_cause: int
    """Its sub cause code of ETSI TS 102 894-2, 0 to 255; 0: not known."""
    x: float
    """x of the event in the world frame [m]."""
    y: float
    """y of the event in the world frame [m]."""
    detection_tick: int
    """When the sender detected the event."""
    validity_s: float
    """[s] The event is over this long after the tick of the pose, unless another DENM comes; at most 6553.5 s."""
    speed: float
    """Of the sender, along its heading [m/s]."""
    length: float
    """Length of the sender's box [m]."""
    width: float
    """Width of the sender's box [m]."""
    termination: Termination = Termination.NONE
    """Whether the event has ended."""


@dataclass(frozen=True, slots=True)
class FeatureGrid:
    """What the sender and the receiver of features must have in common: the grid, and the network that fills it.

    The grid is a bird's-eye view centred on the sender's reference pose: row 0 is ahead, column 0 is left, as in
    `contract.Raster`. Tiles are squares of cells; their index counts row by row.
    """

    name: str
    """Name of the grid and its encoder: 1 to 16 of a-z, 0-9, _ and -, such as "bev-a"."""
    version: int
    """Version of the encoder's weights, 0 to 65535: features of another one mean something else."""
    cell_m: float
    """Edge of a cell [m], in steps of 1 mm."""
    rows: int
    """Cells from front to back, a multiple of `tile_cells`."""
    columns: int
    """Cells from left to right, a multiple of `tile_cells`."""
    channels: int
    """Numbers in each cell, 1 to 64."""
    tile_cells: int = 8
    """Cells along the edge of a tile, 1 to 16."""

    @property
    def tile_rows(self) -> int:
        """Tiles from front to back."""
        return self.rows // self.tile_cells

    @property
    def tile_columns(self) -> int:
        """Tiles from left to right."""
        return self.columns // self.tile_cells

    @property
    def tile_values(self) -> int:
        """Values in a tile."""
        return self.tile_cells * self.tile_cells * self.channels


@dataclass(frozen=True, slots=True)
class Feature:
    """Tiles of a bird's-eye map of features: one packet, which is read without any other of its map.

    All that a map sends at one pose has the same pose and grid. `v2x.feature_map` makes these of a map, and a map of
    those that arrived. Values are whole numbers of `steps`, and only those that are not zero are listed.
    """

    pose: ReferencePose
    """Where the sender was when its sensors saw what the map shows."""
    grid: FeatureGrid
    """The grid and the encoder."""
    steps: Float
    """(C,) quantisation step of each channel, half precision; 0: the channel is 0 everywhere."""
    tiles: npt.NDArray[np.int64]
    """(K,) indices of the tiles, each once, in the order of sending: the most confident first."""
    confidence: Float
    """(K,) confidence of each tile in [0, 1], in steps of 1/255."""
    places: npt.NDArray[np.int64]
    """(N,) where the values stand, ascending: (tile in `tiles` x cells + cell row by row) x channels + channel."""
    levels: npt.NDArray[np.int64]
    """(N,) the values at `places` in steps of their channel: -255 to 255, never 0."""


Content: TypeAlias = Cam | Cpm | Mcm | Denm | Feature | str


def format_track_name(number: int) -> str:
    """Return the name in `Objects.ids` of a track number (32 bits)."""
    return f"t{number:08x}"


@lru_cache(maxsize=4096)  # a sender names the same tracks in every message
def parse_track_name(name: str) -> int:
    """Return the track number of a name. Raises MessageError for names that `format_track_name` does not produce."""
    try:
        number = int(name[1:], 16)
    except ValueError:
        number = -1
    if number < 0 or name != format_track_name(number) or len(name) != 9:
        raise MessageError(f"cpm: expected track names such as t0000002a, found {name!r:.40}")
    return number
