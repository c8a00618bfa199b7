"""leveLXData: read recordings of inD, rounD, exiD and highD (`NN_tracks.csv` with `NN_tracksMeta.csv` and more).

Source: Bock et al., The inD Dataset, IV 2020; Krajewski et al., The highD Dataset, ITSC 2018 and The rounD Dataset,
ITSC 2020; Moers et al., The exiD Dataset, IV 2022, and their descriptions of the columns: 25 frames a second, metres;
inD, rounD and exiD have box centres and headings [degrees] in a frame whose origin is a point in UTM, and Lanelet2
maps; highD has upper left corners of boxes in the image (y down), and lane markings in place of a map.
"""

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from real2sim.hd_map import HdMap, LaneKind, MapLane
from real2sim.readers.input_checks import MAX_ROWS, check_frame_count
from real2sim.readers.lanelet2 import read_lanelet2
from real2sim.readers.tables import TableRow, open_table, read_header, read_rows
from real2sim.recording import ObjectCategory, ObserverView, RecordedTrack, Recording

TRACKS = "_tracks.csv"
CATEGORY_BY_CLASS: Mapping[str, ObjectCategory] = {
    "car": ObjectCategory.CAR,
    "van": ObjectCategory.VAN,
    "truck": ObjectCategory.TRUCK,
    "truck_bus": ObjectCategory.TRUCK,
    "trailer": ObjectCategory.TRUCK,
    "bus": ObjectCategory.BUS,
    "motorcycle": ObjectCategory.MOTORCYCLE,
    "bicycle": ObjectCategory.BICYCLE,
    "pedestrian": ObjectCategory.PEDESTRIAN,
}
"""Classes without case: highD writes Car and Truck."""
MIN_STRIDE = 2
"""Every second frame of 25 a second is taken, near the 10 a second of the other sources; of large logs fewer."""
MAX_RATE_HZ = 100.0
"""[Hz] Chosen: four times the rate of the data sets; a higher one is an error of the file."""
MARKINGS = {"upperLaneMarkings": -1, "lowerLaneMarkings": 1}
"""Column of highD's markings -> direction of the traffic between them along x."""
IMAGE_COLUMNS = ("x", "y", "width", "height")
GROUND_COLUMNS = ("xCenter", "yCenter", "heading", "length", "width")
DIRECTIONS = {"1": math.pi, "2": 0.0}
"""highD's drivingDirection -> heading [rad]: 1 are the upper lanes, which lead to the left."""
LANE_MARGIN_M = 5.0
"""[m] Lanes of highD end this far beyond the outermost boxes."""


@dataclass(frozen=True)
class _Log:
    """The files of one recording, as far as they are common to all tracks."""

    tracks: Path
    meta: Mapping[str, str]
    classes: Mapping[str, ObjectCategory]
    headings: Mapping[str, float]
    """Heading [rad] of every track by its id, for highD only."""
    first: int
    count: int
    """Number of frames of the source."""

    @property
    def is_image(self) -> bool:
        return MARKINGS.keys() <= self.meta.keys()

    @property
    def stride(self) -> int:
        """Frames of the source from one of the recording to the next."""
        return max(MIN_STRIDE, math.ceil(self.count * len(self.classes) / max(MAX_ROWS - len(self.classes), 1)))


def read_levelx(tracks: Path, maps: Sequence[Path] = ()) -> Recording:
    """Read `NN_tracks.csv` with the tables beside it; raise InputError.

    `maps` names the Lanelet2 map of inD, rounD and exiD; by default it is looked for in `maps` folders above. All
    tracks are in one view; none is a connected vehicle.
    """
    log = _read_log(tracks)
    rate = _read_meta_number(log, "frameRate")
    if not 0.0 < rate <= MAX_RATE_HZ:
        raise InputError(f"{_name_sibling(tracks, 'recordingMeta')}: frameRate: expected 1 to 100, found {rate:g}")
    frames = check_frame_count(f"{tracks}: frame", (log.count - 1) // log.stride + 1, len(log.classes))
    tracks_found = _read_tracks(log, frames)
    if log.is_image:
        hd_map, notes = _build_straight_lanes(log, tracks_found), ("lanes made from the markings of the recording",)
    else:
        origin = (_read_meta_number(log, "xUtmOrigin"), _read_meta_number(log, "yUtmOrigin"))
        hd_map, notes = read_lanelet2(_find_map(log, maps), origin)
    return Recording(
        id=tracks.name.removesuffix(".csv"),
        source="levelx",
        dt_s=log.stride / rate,
        frame_count=frames,
        views=(ObserverView("log", tracks_found),),
        map=hd_map,
        notes=(f"one of every {log.stride} frames taken, of {rate:g} a second", *notes),
    )


def _name_sibling(tracks: Path, kind: str) -> Path:
    return tracks.with_name(tracks.name.removesuffix(TRACKS) + f"_{kind}.csv")


def _read_log(tracks: Path) -> _Log:
    if not tracks.name.endswith(TRACKS):
        raise InputError(f"{tracks}: expected the tracks of a recording, NN{TRACKS}, found another name")
    meta = _read_meta(_name_sibling(tracks, "recordingMeta"))
    is_image = MARKINGS.keys() <= meta.keys()
    path = _name_sibling(tracks, "tracksMeta")
    columns = ("id", "class", "drivingDirection") if is_image else ("trackId", "class", "trackId")
    rows = list(read_rows(path, (*columns, "initialFrame", "finalFrame")))
    if not rows:
        raise InputError(f"{path}: expected at least one track, found none")
    first = min(round(row.parse_number(3, "initialFrame")) for row in rows)
    last = max(round(row.parse_number(4, "finalFrame")) for row in rows)
    return _Log(
        tracks,
        meta,
        {row.cells[0]: _classify(row) for row in rows},
        {row.cells[0]: _find_heading(row) for row in rows} if is_image else {},
        first,
        last - first + 1,
    )


def _read_meta(path: Path) -> Mapping[str, str]:
    with open_table(path) as table:
        header, cells = read_header(table), next(table, [])
    if len(cells) != len(header) or not cells:
        raise InputError(f"{path}: expected one row of {len(header)} columns, found {len(cells)}")
    return dict(zip(header, cells, strict=True))


def _read_meta_number(log: _Log, name: str) -> float:
    path = _name_sibling(log.tracks, "recordingMeta")
    if name not in log.meta:
        raise InputError(f"{path}: expected the column {name}, found none")
    return TableRow(str(path), (log.meta[name],)).parse_number(0, name)


def _classify(row: TableRow) -> ObjectCategory:
    category = CATEGORY_BY_CLASS.get(row.cells[1].strip().lower())
    if category is None:
        raise InputError(f"{row.where}: class: expected one of {', '.join(CATEGORY_BY_CLASS)}, found {row.cells[1]!r}")
    return category


def _find_heading(row: TableRow) -> float:
    if row.cells[2] not in DIRECTIONS:
        raise InputError(f"{row.where}: drivingDirection: expected 1 or 2, found {row.cells[2]!r}")
    return DIRECTIONS[row.cells[2]]


def _read_tracks(log: _Log, frames: int) -> tuple[RecordedTrack, ...]:
    id_, values = ("id", IMAGE_COLUMNS) if log.is_image else ("trackId", GROUND_COLUMNS)
    tables: defaultdict[str, Float] = defaultdict(lambda: np.full((frames, 5), np.nan))
    for row in read_rows(log.tracks, (id_, "frame", *values)):
        name, frame = row.cells[0], round(row.parse_number(1, "frame")) - log.first
        if name not in log.classes or not 0 <= frame < log.count:
            raise InputError(f"{row.where}: expected a track and a frame of the tracksMeta, found {row.cells[:2]}")
        if frame % log.stride == 0:
            numbers = [row.parse_number(k, column) for k, column in enumerate(values, start=2)]
            tables[name][frame // log.stride] = _place_in_plane(numbers, log.headings.get(name))
    return tuple(RecordedTrack.from_table(name, log.classes[name], table) for name, table in tables.items())


def _place_in_plane(numbers: Sequence[float], heading: float | None) -> tuple[float, ...]:
    """Return x, y, yaw, length and width of a row, y up."""
    if heading is None:
        x, y, degrees, length, width = numbers
        return x, y, math.radians(degrees), length, width
    x, y, length, width = numbers
    return x + length / 2, -(y + width / 2), heading, length, width


def _find_map(log: _Log, maps: Sequence[Path]) -> Path:
    """Return the one map given, else that of the location in a folder `maps` beside or above the tracks."""
    files = tuple(maps)
    location = log.meta.get("locationId", "")
    if not files:
        above = log.tracks.resolve().parents[:3]
        files = tuple(path for place in above for path in sorted((place / "maps").rglob(f"*location{location}.osm")))
    if len(files) != 1:
        raise InputError(
            f"{log.tracks}: expected one Lanelet2 map maps/.../location{location}.osm (or --map), found {len(files)}"
        )
    return files[0]


def _build_straight_lanes(log: _Log, tracks: Sequence[RecordedTrack]) -> HdMap:
    """Build highD's lanes between its markings, along the stretch in which vehicles were seen."""
    path = _name_sibling(log.tracks, "recordingMeta")
    x = np.concatenate([track.x[track.valid] for track in tracks] or [np.zeros(1)])
    ends = np.array((x.min() - LANE_MARGIN_M, x.max() + LANE_MARGIN_M))
    limit = _read_meta_number(log, "speedLimit")
    lanes: dict[str, MapLane] = {}
    for name, direction in MARKINGS.items():
        texts = [text for text in log.meta[name].split(";") if text.strip()]
        bounds = sorted(TableRow(str(path), (text,)).parse_number(0, name) for text in texts)
        if len(bounds) < 2:
            raise InputError(f"{path}: {name}: expected at least two markings, found {log.meta[name]!r}")
        side = name.removesuffix("LaneMarkings")
        for k in range(len(bounds) - 1):
            lane = _build_straight_lane(side, k, bounds, ends[::direction], limit)
            lanes[lane.id] = lane
    return HdMap(lanes, left_hand=False)


def _build_straight_lane(side: str, k: int, bounds: Sequence[float], ends: Float, limit: float) -> MapLane:
    """Build the lane between two markings, whose numbers grow downwards in the image; `ends` in its direction."""
    upper, lower = (np.column_stack((ends, np.full(2, -bounds[n]))) for n in (k, k + 1))
    leads_right = ends[1] > ends[0]
    count = len(bounds) - 1
    above, below = (f"{side}{n}" if 0 <= n < count else "" for n in (k - 1, k + 1))
    return MapLane(
        id=f"{side}{k}",
        kind=LaneKind.DRIVING,
        centre=(upper + lower) / 2,
        left=upper if leads_right else lower,
        right=lower if leads_right else upper,
        left_neighbour=above if leads_right else below,
        right_neighbour=below if leads_right else above,
        group=side,
        width=bounds[k + 1] - bounds[k],
        speed_limit=limit if limit > 0 else math.nan,  # -1: no limit
    )
