"""CommonRoad: read scenarios with recorded traffic (.xml, 2018b and 2020a) through commonroad-io.

Source: Althoff, Koschi and Manzinger, CommonRoad, IV 2017, and its documentation of the XML formats. Metres, radians,
full sizes; a state is the box centre (or `originXShift` from it).
"""

import logging
import math
import warnings
from collections import Counter
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from shapely.errors import ShapelyError

from mdrive_sumo.core.errors import InputError
from real2sim.readers.commonroad_map import build_commonroad_map
from real2sim.readers.input_checks import build_missing_error, check_frame_count
from real2sim.recording import ObjectCategory, ObserverView, RecordedTrack, Recording
from real2sim.xml_file import Element, read_number, read_xml

VERSIONS = ("2018b", "2020a")
CATEGORY_BY_TYPE: Mapping[str, ObjectCategory] = {
    "car": ObjectCategory.CAR,
    "taxi": ObjectCategory.CAR,
    "priorityVehicle": ObjectCategory.CAR,
    "parkedVehicle": ObjectCategory.CAR,
    "vehicle": ObjectCategory.CAR,
    "truck": ObjectCategory.TRUCK,
    "bus": ObjectCategory.BUS,
    "motorcycle": ObjectCategory.MOTORCYCLE,
    "bicycle": ObjectCategory.BICYCLE,
    "pedestrian": ObjectCategory.PEDESTRIAN,
    "constructionZone": ObjectCategory.STATIC,
    "roadBoundary": ObjectCategory.STATIC,
    "building": ObjectCategory.STATIC,
    "pillar": ObjectCategory.STATIC,
    "median_strip": ObjectCategory.STATIC,
}
EXPORT_SOURCE = "mdrive-sumo"
"""Begins the source of files that `mdrive-sumo export` has written: their tracks are those of a simulation."""
LINK_TAGS = ("predecessor", "successor", "adjacentLeft", "adjacentRight")
LIBRARY_ERRORS = (AssertionError, AttributeError, IndexError, KeyError, TypeError, ValueError)
"""Exceptions that commonroad-io raises for invalid scenarios."""
NUMBER_TAGS = frozenset(
    {"x", "y", "length", "width", "radius", "originXShift", "exact", "intervalStart", "intervalEnd"}
)
MAX_ANGLE = 1e4
"""[rad] commonroad-io subtracts full turns one by one."""
OBSTACLE_TAGS = ("obstacle", "staticObstacle", "dynamicObstacle")
MAX_HEADING_SPREAD = math.pi / 2
"""[rad] The middle of a wider interval of orientations does not tell which way an obstacle faces."""


def read_commonroad(path: Path) -> Recording:
    """Read a scenario; raise InputError, also for versions other than 2018b and 2020a.

    All obstacles are in one view. Planning problems are ignored
    because they have no recorded motion.
    """
    root = read_xml(path)
    _check_file(path, root)
    notes = list(_drop_unsupported(root))
    scenario, remarks = _parse_scenario(path, root)
    tracks, track_notes = _build_tracks(path, scenario)
    return Recording(
        id=str(root.get("benchmarkID") or path.stem),
        source="commonroad",
        dt_s=float(scenario.dt),
        frame_count=len(tracks[0].valid),
        views=(ObserverView("log", tracks),),
        map=build_commonroad_map(path, scenario.lanelet_network),
        notes=(*notes, *remarks, *track_notes),
        exact=str(root.get("source")).startswith(EXPORT_SOURCE),
    )


def _check_file(path: Path, root: Element) -> None:
    """Check what commonroad-io would reject with an assertion or a bare Exception."""
    if root.tag != "commonRoad":
        raise InputError(f"{path}: expected the root <commonRoad>, found <{root.tag}>")
    if root.get("commonRoadVersion") not in VERSIONS:
        raise InputError(
            f"{path}: commonRoadVersion: expected {' or '.join(VERSIONS)}, found {root.get('commonRoadVersion')!r}"
        )
    if read_number(path, root, "timeStepSize") <= 0:
        raise InputError(f"{path}: timeStepSize: expected a positive number, found {root.get('timeStepSize')!r}")
    if root.find("lanelet") is None:
        raise InputError(f"{path}: expected at least one <lanelet>, found none")
    for element in root:
        _check_numbers(path, element)
    for obstacle in _list_obstacles(root):
        for state in (*obstacle.iter("initialState"), *obstacle.iter("state")):
            _check_state(path, obstacle, state)


def _check_numbers(path: Path, element: Element) -> None:
    for value in element.iter():
        try:
            fine = value.tag not in NUMBER_TAGS or math.isfinite(float(value.text or ""))
        except ValueError:
            fine = False
        if not fine:
            where = f"{path}: {element.tag} {element.get('id')}"
            raise InputError(f"{where}: {value.tag}: expected a finite number, found {value.text!r:.80}")
    for angle in (value for turned in element.iter("orientation") for value in turned):
        if abs(float(angle.text or "")) > MAX_ANGLE:
            where = f"{path}: {element.tag} {element.get('id')}"
            raise InputError(f"{where}: orientation: expected at most {MAX_ANGLE:g} rad, found {angle.text!r:.80}")


def _list_obstacles(root: Element) -> Iterator[Element]:
    return (element for element in root if element.tag in OBSTACLE_TAGS)


def _check_state(path: Path, obstacle: Element, state: Element) -> None:
    where = f"{path}: obstacle {obstacle.get('id')}"
    for name in ("position", "orientation", "time"):
        if state.find(name) is None:
            raise InputError(f"{where}: expected <{name}> in every state, found one without")
    for value in state:
        wanted = ("point", "rectangle", "circle", "polygon") if value.tag == "position" else ("exact", "intervalStart")
        if all(value.find(name) is None for name in wanted):
            raise InputError(f"{where}: {value.tag}: expected one of {', '.join(wanted)}, found none of them")


def _drop_unsupported(root: Element) -> Iterator[str]:
    """Remove elements that are not needed or not readable by commonroad-io; yield notes on the latter."""
    for problem in root.findall("planningProblem"):
        root.remove(problem)
    groups = [
        obstacle
        for obstacle in _list_obstacles(root)
        if (shape := obstacle.find("shape")) is not None and len(shape) > 1
    ]
    for obstacle in groups:
        root.remove(obstacle)
    if groups:
        yield f"{len(groups)} obstacles of more than one shape skipped"
    vague = [
        obstacle
        for obstacle in _list_obstacles(root)
        if any(time.find("exact") is None for time in obstacle.iter("time"))
    ]
    for obstacle in vague:
        root.remove(obstacle)
    if vague:
        yield f"{len(vague)} obstacles without exact times skipped"
    there = {lanelet.get("id") for lanelet in root.iter("lanelet")}
    lost = [(lanelet, link) for lanelet in root.iter("lanelet") for name in LINK_TAGS for link in lanelet.findall(name)]
    lost = [(lanelet, link) for lanelet, link in lost if link.get("ref") not in there]
    for lanelet, link in lost:
        lanelet.remove(link)
    if lost:
        yield f"{len(lost)} links to lanelets that are not in the file skipped"


def _load_reader_class(path: Path) -> Any:
    """Import the reader class of commonroad-io here because the import is slow."""
    try:
        with _capture_remarks():  # remarks of its dependencies do not concern the file
            from commonroad.common.file_reader import CommonRoadFileReader
    except ImportError:
        raise build_missing_error(path, "commonroad-io") from None
    return CommonRoadFileReader


def _parse_scenario(path: Path, root: Element) -> tuple[Any, tuple[str, ...]]:
    """Return the scenario and the library's remarks."""
    reader = _load_reader_class(path)
    with _capture_remarks() as remarks:
        try:
            scenario = reader(ElementTree.tostring(root)).open()[0]
        except (*LIBRARY_ERRORS, ShapelyError) as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            what = "an element is missing: " if isinstance(error, AttributeError) else ""
            raise InputError(f"{path}: expected a valid CommonRoad scenario, found: {what}{reason}") from None
    return scenario, (f"commonroad-io made {len(remarks)} remarks, the first: {remarks[0]}",) if remarks else ()


@contextmanager
def _capture_remarks() -> Generator[list[str]]:
    """Capture warnings and log messages of commonroad-io instead of showing them."""
    remarks: list[str] = []
    handler = logging.Handler(logging.WARNING)
    handler.emit = lambda record: remarks.append(record.getMessage())
    logger = logging.getLogger("commonroad")
    propagate, logger.propagate = logger.propagate, False
    logger.addHandler(handler)
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            yield remarks
        remarks += [str(warning.message) for warning in caught]
    finally:
        logger.removeHandler(handler)
        logger.propagate = propagate


def _build_tracks(path: Path, scenario: Any) -> tuple[tuple[RecordedTrack, ...], tuple[str, ...]]:
    kept: list[tuple[Any, ObjectCategory, Sequence[Any]]] = []
    skipped: Counter[str] = Counter()
    for obstacle in scenario.obstacles:
        reason = _find_skip_reason(obstacle)
        if reason:
            skipped[reason] += 1
        else:
            kept.append((obstacle, _classify(obstacle), _list_states(obstacle)))
    times = [state.time_step for obstacle, _, states in kept if _is_dynamic(obstacle) for state in states]
    if not times:
        raise InputError(f"{path}: expected at least one dynamic obstacle with a trajectory, found none")
    check_frame_count(f"{path}: time", max(times) - min(times) + 1, len(kept))
    span = range(min(times), max(times) + 1)
    tracks = tuple(_build_track(path, obstacle, category, states, span) for obstacle, category, states in kept)
    notes = (f"{count} obstacles {why} skipped" for why, count in sorted(skipped.items()))
    return tracks, (*notes, *note_vague_states([states for _, _, states in kept]))


def _find_skip_reason(obstacle: Any) -> str:
    if not hasattr(obstacle, "initial_state") or obstacle.initial_state is None:
        return "without a state"
    if obstacle.obstacle_type.value not in (*CATEGORY_BY_TYPE, "unknown"):
        return f"of the type {obstacle.obstacle_type.value}"
    if _is_dynamic(obstacle) and obstacle.prediction is not None and not hasattr(obstacle.prediction, "trajectory"):
        return "with a set-based prediction"
    return ""


def _is_dynamic(obstacle: Any) -> bool:
    return bool(obstacle.obstacle_role.value == "dynamic")


def _classify(obstacle: Any) -> ObjectCategory:
    unknown = ObjectCategory.CAR if _is_dynamic(obstacle) else ObjectCategory.STATIC
    return CATEGORY_BY_TYPE.get(obstacle.obstacle_type.value, unknown)


def _list_states(obstacle: Any) -> Sequence[Any]:
    prediction = getattr(obstacle, "prediction", None)
    return (obstacle.initial_state, *(prediction.trajectory.state_list if prediction is not None else ()))


def _build_track(
    path: Path, obstacle: Any, category: ObjectCategory, states: Sequence[Any], span: range
) -> RecordedTrack:
    where = f"{path}: obstacle {obstacle.obstacle_id}"
    poses = np.array([read_pose(state) for state in states], dtype=np.float64)
    table = np.full((len(span), 3), np.nan)
    if _is_dynamic(obstacle):
        table[[state.time_step - span.start for state in states]] = poses
    else:
        table[:] = poses[0]
    ahead, left, length, width = _compute_box(where, obstacle.obstacle_shape)
    x, y, yaw = table.T
    valid = np.isfinite(x)
    turn = np.where(np.isfinite(yaw), yaw, 0.0)
    return RecordedTrack(
        id=str(obstacle.obstacle_id),
        category=category,
        valid=valid,
        x=x + ahead * np.cos(turn) - left * np.sin(turn),
        y=y + ahead * np.sin(turn) + left * np.cos(turn),
        yaw=yaw,
        length=np.where(valid, length, np.nan),
        width=np.where(valid, width, np.nan),
        parked=not _is_dynamic(obstacle) or obstacle.obstacle_type.value == "parkedVehicle",
    )


def _compute_box(where: str, shape: Any) -> tuple[float, float, float, float]:
    """Return the offset (ahead, left) of the box centre from the state's position, and length and width [m]."""
    from commonroad.scenario.state import CustomState

    if hasattr(shape, "radius"):
        box = (0.0, 0.0, 2 * float(shape.radius), 2 * float(shape.radius))
    else:
        at_origin = shape.compute_occupancy(CustomState(time_step=0, position=np.zeros(2), orientation=0.0))
        x0, y0, x1, y1 = at_origin.shapely_object.bounds
        box = ((x0 + x1) / 2, (y0 + y1) / 2, x1 - x0, y1 - y0)
    if not (math.isfinite(sum(box)) and min(box[2:]) > 0):
        raise InputError(f"{where}: shape: expected a positive length and width, found {box[2]:g} and {box[3]:g}")
    return box


def read_pose(state: Any) -> tuple[float, float, float]:
    """Return x, y [m] and yaw [rad] of a state: the centre of an area, the middle of a narrow interval, else NaN."""
    return *_find_position(state), _read_angle(state.orientation)


def note_vague_states(obstacles: Sequence[Sequence[Any]]) -> Iterator[str]:
    """Yield notes on states that are sets; `obstacles` are the states of each."""
    shapes = sum(any(not isinstance(state.position, np.ndarray) for state in states) for states in obstacles)
    intervals = sum(any(not isinstance(state.orientation, int | float) for state in states) for states in obstacles)
    if shapes:
        yield f"{shapes} obstacles whose positions are areas: their centres taken"
    if intervals:
        yield (
            f"{intervals} obstacles whose orientations are intervals: their middles taken,"
            f" none of intervals over {math.degrees(MAX_HEADING_SPREAD):g} degrees"
        )


def _find_position(state: Any) -> tuple[float, float]:
    """Return the position of a state, the centre if it is an area."""
    if isinstance(state.position, np.ndarray):
        return float(state.position[0]), float(state.position[1])
    return float(state.position.center.x), float(state.position.center.y)


def _read_angle(orientation: Any) -> float:
    """Return the angle [rad], the middle of a narrow interval, NaN for a wide one."""
    if isinstance(orientation, int | float):
        return float(orientation)
    spread = float(orientation.end - orientation.start)
    return float(orientation.start) + spread / 2 if spread <= MAX_HEADING_SPREAD else math.nan
