"""Who is in whose way: the conflict graph of protocol 10.3."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.negotiation.intention import INTERVAL_S, POINTS
from mdrive_sumo.negotiation.negotiator import NegotiationMember

SAFE = 0.75
"""Pairs that are less safe are in conflict: closer than 3.55 m at the same time."""
STEP_TICKS = round(INTERVAL_S * TICKS_PER_SECOND)
"""Ticks between two points of a prediction, and between two planning steps."""
AFTERMATH_TICKS = 20
"""How long a decision holds after the time of conflict."""


def find_next_planning_tick(tick: int) -> int:
    """The tick of the next planning step; who thinks for longer than a tick may not be asked in that very tick."""
    return (tick // STEP_TICKS + 1) * STEP_TICKS


def compute_safety(distance: float) -> float:
    """How safe it is to come that close [m], in (0, 1)."""
    return 1 / (1 + math.exp(min(-2 * (distance - 3), 700.0)))


@dataclass(frozen=True)
class ConflictGraph:
    """All pairs of members by their closest approach; matrices are (N, N) in the order of ids, symmetric."""

    ids: tuple[str, ...]
    distance: Float
    """[m], infinite on the diagonal."""
    step: Int
    """Index of the prediction's point at the closest approach: 0 lies one step ahead."""
    in_conflict: Bool
    distance_to_conflict: Float
    """(N,) straight distance [m] from each member's first predicted point to that of its nearest closest approach:
    its distance to conflict, 1000 if it is alone (protocol 10.5). Cars of the same speed are the same distance from
    where they are closest at the same time, so this lets the slower one go first, whoever is nearer to the crossing."""
    entry_time: Float
    """(N, N) [s] after what time the one of the row enters what it shares with the one of the column, whenever that
    is there; infinite where they share nothing."""

    def find_opponents(self, name: str) -> frozenset[str]:
        """Whom a member is in conflict with."""
        row = self.in_conflict[self.ids.index(name)]
        return frozenset(other for other, yes in zip(self.ids, row.tolist(), strict=True) if yes)

    def find_group(self, name: str) -> tuple[str, ...]:
        """The connected component with that member, sorted; empty if it is in no conflict."""
        found, todo = {name}, [name]
        while todo:
            new = self.find_opponents(todo.pop()) - found
            found |= new
            todo.extend(new)
        return tuple(sorted(found)) if len(found) > 1 else ()

    def count_conflict_ticks(self, group: Sequence[str]) -> int:
        """How many ticks from now the last conflict of a group takes place: 4 k*, k* counted from 1."""
        rows = [self.ids.index(name) for name in group]
        among = np.ix_(rows, rows)
        return int(((self.step[among] + 1) * self.in_conflict[among]).max()) * STEP_TICKS

    def get_distance_to_conflict(self, name: str) -> float:
        """Distance to conflict [m] of a member."""
        return float(self.distance_to_conflict[self.ids.index(name)])

    def get_entry_time(self, name: str) -> float:
        """When a member enters the first place [s] that it shares with a foe; infinite if there is none."""
        row = self.ids.index(name)
        return float(self.entry_time[row].min(where=self.in_conflict[row], initial=np.inf))


def build_conflict_graph(members: Sequence[NegotiationMember], use_planned: bool = False) -> ConflictGraph:
    """The graph of the desired (or planned) trajectories of members, which have all the same times."""
    ids = tuple(member.id for member in members)
    predicted = {m.id: m.planned if use_planned and len(m.planned) else m.desired for m in members}
    return build_trajectory_graph(ids, predicted)


def build_trajectory_graph(ids: tuple[str, ...], predicted: Mapping[str, Float]) -> ConflictGraph:
    """The graph of trajectories (`POINTS`, 2) [m] by id, all of the same times."""
    count = len(ids)
    points = np.array([predicted[name] for name in ids]).reshape(count, POINTS, 2)
    anytime = np.sqrt(((points[:, None, :, None] - points[None, :, None]) ** 2).sum(-1))
    gaps = np.diagonal(anytime, axis1=2, axis2=3)
    step = gaps.argmin(-1)
    distance = np.take_along_axis(gaps, step[..., None], -1)[..., 0]
    np.fill_diagonal(distance, np.inf)
    return ConflictGraph(ids, distance, step, distance < _LEAST, _runs(points, step), _entries(anytime))


def compute_free_distance(me: NegotiationMember, first: Iterable[NegotiationMember]) -> float:
    """How far I can drive [m] on my desired way until I am too near to where one of the first wants to be, whenever
    that is; infinite if my prediction comes nowhere near."""
    points = np.vstack(((me.x, me.y), me.desired))
    theirs = [np.vstack(((other.x, other.y), other.desired)) for other in first]
    near = [np.hypot(*(points[:, None] - way[None]).T).min(axis=0) < _LEAST for way in theirs]
    met = np.flatnonzero(np.logical_or.reduce(near)) if near else np.zeros(0, dtype=np.int64)
    return float(np.hypot(*np.diff(points[: met[0] + 1], axis=0).T).sum()) if len(met) else math.inf


def _runs(points: Float, step: Int) -> Float:
    """`Graph.run`: over all pairs, conflicting or not, as the original does."""
    count = len(points)
    meeting = points[np.arange(count)[:, None], step]
    runs = np.hypot(*np.moveaxis(meeting - points[:, :1], -1, 0))
    np.fill_diagonal(runs, 1000.0)
    return np.minimum(runs.min(axis=1, initial=1000.0), 1000.0)


def _entries(anytime: Float) -> Float:
    """`Graph.entry` from distances (N, N, K, L) [m] between the K points of one and the L points of the other."""
    shared = anytime.min(-1) < _LEAST
    entry = np.where(shared.any(-1), (shared.argmax(-1) + 1) * INTERVAL_S, np.inf)
    np.fill_diagonal(entry, np.inf)
    return entry


_LEAST = 3 + math.log(SAFE / (1 - SAFE)) / 2
"""The distance [m] whose safety is `SAFE`."""
