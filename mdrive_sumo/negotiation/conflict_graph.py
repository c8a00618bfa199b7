"""The conflict graph of the protocol (10.3): which CAVs come too close to each other."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.negotiation.intention import INTERVAL_S, POINTS
from mdrive_sumo.negotiation.negotiator import NegotiationMember

STEP_TICKS = round(INTERVAL_S * TICKS_PER_SECOND)
"""Ticks between two points of a prediction, and between two planning steps."""


@dataclass(frozen=True, slots=True)
class ConflictParameters:
    """Parameters of conflicts. Source: protocol 10.3 and 10.5."""

    min_safety: float = 0.75
    """A pair with less safety is in conflict: closer than 3.55 m at the same time."""
    aftermath_ticks: int = 20
    """A decision holds for this long after the time of conflict."""
    free_distance_m: float = 1000.0
    """Distance to conflict of a CAV without any other CAV."""

    @property
    def min_distance_m(self) -> float:
        """The distance [m] at which `compute_safety` is `min_safety`."""
        return 3 + portable.log(self.min_safety / (1 - self.min_safety)) / 2


CONFLICT = ConflictParameters()
MAX_STEP_M = 2.05
"""Largest distance between points of trajectories that are compared point by point: 10 m/s for 0.2 s."""


def find_next_planning_tick(tick: int) -> int:
    """Return the tick of the next planning step; an agent that thinks for longer than a tick may miss a tick."""
    return (tick // STEP_TICKS + 1) * STEP_TICKS


def compute_safety(distance: float) -> float:
    """Return the safety of a closest approach at that distance [m], in (0, 1)."""
    return 1 / (1 + portable.exp(min(-2 * (distance - 3), 700.0)))


@dataclass(frozen=True)
class ConflictGraph:
    """All pairs of members by their closest approach; matrices are (N, N) in the order of ids, symmetric, read-only."""

    ids: tuple[str, ...]
    """Station ids, in the order of rows and columns."""
    distance: Float
    """[m], infinite on the diagonal."""
    step: Int
    """Index of the prediction's point at the closest approach: 0 lies one step ahead."""
    in_conflict: Bool
    """(N, N) closer than `ConflictParameters.min_distance_m` at their closest approach."""
    distance_to_conflict: Float
    """(N,) straight distance [m] from each member's first predicted point to that of its nearest closest approach, 1000
    if it is alone (protocol 10.5). Cars of the same speed are equally far from their closest approach, so this measure
    lets the slower one go first, whichever is nearer to the crossing."""
    entry_time: Float
    """(N, N) [s] after which the member of the row enters the area that it shares with the member of the column, at
    whatever time that one is there; infinite where they share nothing."""

    def find_opponents(self, name: str) -> frozenset[str]:
        """Return the members in conflict with a member."""
        row = self.in_conflict[self.ids.index(name)]
        return frozenset(other for other, yes in zip(self.ids, row.tolist(), strict=True) if yes)

    def find_group(self, name: str) -> tuple[str, ...]:
        """Return the connected component with that member, sorted; empty if the member has no conflict."""
        group, unvisited = {name}, [name]
        while unvisited:
            new = self.find_opponents(unvisited.pop()) - group
            group |= new
            unvisited.extend(new)
        return tuple(sorted(group)) if len(group) > 1 else ()

    def count_conflict_ticks(self, group: Sequence[str]) -> int:
        """Return the ticks until the last conflict of a group: 4 k*, k* counted from 1."""
        rows = [self.ids.index(name) for name in group]
        among = np.ix_(rows, rows)
        return int(((self.step[among] + 1) * self.in_conflict[among]).max()) * STEP_TICKS

    def get_distance_to_conflict(self, name: str) -> float:
        """Return the distance to conflict [m] of a member."""
        return float(self.distance_to_conflict[self.ids.index(name)])

    def get_entry_time(self, name: str) -> float:
        """Return when a member enters the first area [s] that it shares with an opponent; infinite if there is none."""
        row = self.ids.index(name)
        return float(self.entry_time[row].min(where=self.in_conflict[row], initial=np.inf))


def build_conflict_graph(members: Sequence[NegotiationMember], use_planned: bool = False) -> ConflictGraph:
    """Return the graph of the desired (or planned) trajectories of members."""
    ids = tuple(member.id for member in members)
    predicted = {m.id: m.planned if use_planned and len(m.planned) else m.desired for m in members}
    return build_trajectory_graph(ids, predicted)


def build_trajectory_graph(ids: tuple[str, ...], trajectory_by_id: Mapping[str, Float]) -> ConflictGraph:
    """Return the graph of simultaneous trajectories (`POINTS`, 2) [m]."""
    points = np.array([trajectory_by_id[name] for name in ids]).reshape(len(ids), POINTS, 2)
    pairs = compare_trajectories(points, CONFLICT.min_distance_m, MAX_STEP_M, CONFLICT.free_distance_m)
    columns = pairs.distance, pairs.step, pairs.in_conflict, pairs.distance_to_conflict, pairs.entry_time
    for column in columns:
        column.setflags(write=False)
    return ConflictGraph(ids, *columns)


@dataclass(frozen=True, slots=True)
class TrajectoryPairs:
    """The arrays of a `ConflictGraph`."""

    distance: Float
    step: Int
    in_conflict: Bool
    distance_to_conflict: Float
    entry_time: Float


@twin
def compare_trajectories(points: Float, min_distance_m: float, max_step_m: float, free_m: float, /) -> TrajectoryPairs:
    """Return all pairs of trajectories (N, `POINTS`, 2) [m].

    min_distance_m, free_m: of `ConflictParameters`; max_step_m: `MAX_STEP_M`.
    """
    x, y = points[..., 0], points[..., 1]
    dx, dy = x[:, None, :, None] - x[None, :, None], y[:, None, :, None] - y[None, :, None]
    at_any_time = portable.hypot(dx, dy)
    gaps = _close_between_points(points, np.diagonal(at_any_time, axis1=2, axis2=3), max_step_m)
    step = gaps.argmin(-1)
    distance = np.take_along_axis(gaps, step[..., None], -1)[..., 0]
    np.fill_diagonal(distance, np.inf)
    to_conflict = _compute_distances_to_conflict(points, step, free_m)
    entry_time = _compute_entry_times(at_any_time, min_distance_m)
    return TrajectoryPairs(distance, step, distance < min_distance_m, to_conflict, entry_time)


def compute_free_distance(member: NegotiationMember, others: Iterable[NegotiationMember]) -> float:
    """Return how far a member can drive [m] along its desired trajectory before it comes too close to those of others.

    The times do not matter. Infinite if the trajectories stay apart.
    """
    points = densify(np.vstack(((member.x, member.y), member.desired)))
    theirs = [densify(np.vstack(((other.x, other.y), other.desired))) for other in others]
    min_distance_m = CONFLICT.min_distance_m
    near = [portable.hypot(*(points[:, None] - line[None]).T).min(axis=0) < min_distance_m for line in theirs]
    met = np.flatnonzero(np.logical_or.reduce(near)) if near else np.zeros(0, dtype=np.int64)
    return float(portable.hypot(*np.diff(points[: met[0] + 1], axis=0).T).sum()) if len(met) else math.inf


def _compute_distances_to_conflict(points: Float, step: Int, free_m: float) -> Float:
    """Return `ConflictGraph.distance_to_conflict`: over all pairs, in conflict or not, as the original does."""
    meeting = points[np.arange(len(points))[:, None], step]
    distances = portable.hypot(*np.moveaxis(meeting - points[:, :1], -1, 0))
    np.fill_diagonal(distances, free_m)
    return np.minimum(distances.min(axis=1, initial=free_m), free_m)


def _close_between_points(points: Float, gaps: Float, max_step_m: float) -> Float:
    """Return the distances (N, N, K) [m] of each pair at its points, with the least since the point before.

    Up to `max_step_m` from point to point the points are enough: `gaps` is returned as it is.
    """
    x, y = points[..., 0], points[..., 1]
    step_x, step_y = np.diff(x, axis=1), np.diff(y, axis=1)
    if not len(points) or float((step_x * step_x + step_y * step_y).max()) <= max_step_m * max_step_m:
        return gaps
    before_x, before_y = x[:, None, :-1] - x[None, :, :-1], y[:, None, :-1] - y[None, :, :-1]
    change_x, change_y = step_x[:, None] - step_x[None], step_y[:, None] - step_y[None]
    square = change_x * change_x + change_y * change_y
    ahead = before_x * change_x + before_y * change_y
    share = np.clip(-ahead / np.maximum(square, 1e-9), 0.0, 1.0)
    least = portable.hypot(before_x + share * change_x, before_y + share * change_y)
    return np.concatenate((gaps[..., :1], np.minimum(gaps[..., 1:], least)), axis=-1)


def densify(line: Float, max_step_m: float = MAX_STEP_M) -> Float:
    """Return a line (N, 2) [m] with as many points in between as it needs; itself at the speeds of the protocol."""
    lengths = portable.hypot(*np.diff(line, axis=0).T)
    if not len(lengths) or float(lengths.max()) <= max_step_m:
        return line
    parts = int(np.ceil(float(lengths.max()) / max_step_m))
    shares = np.arange(parts) / parts
    between = line[:-1, None] + shares[None, :, None] * (line[1:] - line[:-1])[:, None]
    return np.vstack((between.reshape(-1, 2), line[-1:]))


def _compute_entry_times(at_any_time: Float, min_distance_m: float) -> Float:
    """Return `ConflictGraph.entry_time` from the distances (N, N, K, L) [m] between the points of each pair."""
    shared = at_any_time.min(-1) < min_distance_m
    entry_time = np.where(shared.any(-1), (shared.argmax(-1) + 1) * INTERVAL_S, np.inf)
    np.fill_diagonal(entry_time, np.inf)
    return entry_time
