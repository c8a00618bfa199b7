"""The rule: the CAV nearest to the conflict goes first (protocol 10.5)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from mdrive_sumo.contract import Message
from mdrive_sumo.contract.briefing import V2xRate
from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.negotiation.conflict_graph import (
    CONFLICT,
    MAX_STEP_M,
    ConflictGraph,
    build_conflict_graph,
    densify,
    find_next_planning_tick,
)
from mdrive_sumo.negotiation.intention import replace_slow_keep
from mdrive_sumo.negotiation.mcm_sending import McmSending
from mdrive_sumo.negotiation.negotiator import NegotiationDecision, NegotiationMember, NegotiationStep
from mdrive_sumo.negotiation.peer_table import PeerTable, PeerView, predict_view
from mdrive_sumo.negotiation.right_of_way_claims import (
    NegotiationTerms,
    RightOfWayClaims,
    answer_claims,
    build_mcm_message,
    collect_claims,
)
from mdrive_sumo.planning.planning_order import order_by_urgency
from mdrive_sumo.v2x.messages import MAX_NAMES, Intention, Mcm


@dataclass(frozen=True, slots=True)
class LeaderParameters:
    """When a CAV leads another one on its path. Both values are design choices."""

    max_lateral_m: float = 1.5
    """[m] Distance of the leader from the follower's desired trajectory: less than half a lane."""
    same_direction_cos: float = 0.5
    """Cosine of the largest angle (60 degrees) between leader and follower."""


LEADER = LeaderParameters()
NO_DECISION = NegotiationDecision(Intention.KEEP)


CACHED_VIEWS = 64
"""CAVs with equal views come one after the other; more than 12 CAVs have in two planning steps, all different."""


def select_winner(group: Sequence[str], graph: ConflictGraph, claims: RightOfWayClaims = frozenset()) -> str:
    """Return the member that goes first: among those with a claim, else among all, the nearest to its conflict.

    Ties go to the smaller id.
    """
    overruled = {second for first, second in claims if first in group}
    claimants = {first for first, second in claims if second in group and first in group} - overruled
    return min(claimants or group, key=lambda name: (graph.get_distance_to_conflict(name), name))


def choose_winner_intention(member: NegotiationMember) -> Intention:
    """Return the action of a member that goes first: its intention, but it neither stops nor keeps a low speed."""
    return Intention.FASTER if member.intention == Intention.STOP else replace_slow_keep(member.intention, member.speed)


def apply_rule(
    members: Sequence[NegotiationMember], graph: ConflictGraph, group: Sequence[str]
) -> dict[str, Intention]:
    """Return the action of every member of a group by the rule: the winner goes, all others stop."""
    winner = select_winner(group, graph)
    in_group = [member for member in members if member.id in group]
    return {m.id: choose_winner_intention(m) if m.id == winner else Intention.STOP for m in in_group}


class RuleNegotiator:
    """Applies the rule to the own view of the common MCMs, and announces the result in the own MCM.

    A conflict is settled once: while a claim holds, the winner stays first, even when it is no longer the nearest.
    passing: the losers do not stop; the group lines up by the times at which its members enter the shared areas, and
    they pass one behind the other. compat_ego0: reproduce a defect of the original, see protocol 10.5: the first
    station of all stops when it holds a decision of its own while others negotiate without it. rate: see
    `Briefing.v2x_rate`.
    """

    def __init__(self, passing: bool = False, compat_ego0: bool = False, rate: V2xRate = "fixed") -> None:
        self._passing, self._compat_ego0 = passing, compat_ego0
        self._sending = McmSending(rate)
        self.peers = PeerTable(self._sending.memory_ticks)
        self._settled_by_id: dict[str, tuple[bool, int]] = {}
        """By other station: whether it goes first, and until which tick that holds."""
        self._decision: NegotiationDecision | None = None
        self._due_tick = 0

    def is_due(self, tick: int) -> bool:
        """Implement `Negotiator.is_due`."""
        return tick >= self._due_tick

    def step(self, tick: int, me: NegotiationMember, heard: Sequence[Message]) -> NegotiationStep:
        """Implement `Negotiator.step`."""
        for message in heard:
            self.peers.receive(message)
        if not self.is_due(tick):
            return NegotiationStep(self.get_valid_decision(tick))
        self._due_tick = find_next_planning_tick(tick)
        mcm_by_station = self.peers.get_latest_mcms(tick)
        claims = collect_claims(mcm_by_station, tick)
        self._update_decision(tick, me.id, self.peers.get_view(tick), claims)
        message = build_mcm_message(me, tick, self._build_terms(me, tick, mcm_by_station, claims))
        if not self._sending.is_due(tick, message):
            return NegotiationStep(self.get_valid_decision(tick))
        self.peers.receive(message)
        return NegotiationStep(self.get_valid_decision(tick), (message,))

    def get_valid_decision(self, tick: int) -> NegotiationDecision | None:
        """Implement `Negotiator.get_valid_decision`."""
        decision = self._decision
        return decision if decision is not None and tick <= decision.until_tick else None

    def _update_decision(self, tick: int, me: str, view: PeerView, claims: RightOfWayClaims) -> None:
        """Update the decision from the present view."""
        graph = _build_view_graph(view)
        group = graph.find_group(me) if me in graph.ids else ()
        if group:
            self._settle_group(tick, me, view, graph, claims)
        known = set(graph.ids)
        self._settled_by_id = {
            name: settled for name, settled in self._settled_by_id.items() if settled[1] >= tick and name in known
        }
        first = frozenset(name for name, (goes_first, _) in self._settled_by_id.items() if goes_first)
        after = frozenset(self._settled_by_id) - first
        if not self._settled_by_id:
            self._decision = None
            return
        mine = next(member for member in predict_view(view) if member.id == me)
        must_wait = bool(first) or self._has_original_defect(me, graph, group)
        intention = self._waiting_intention if must_wait else choose_winner_intention(mine)
        until = max(until for _, until in self._settled_by_id.values())
        group = group or (self._decision or NO_DECISION).group
        self._decision = NegotiationDecision(intention, first, after, until, group)

    @property
    def _waiting_intention(self) -> Intention:
        """The intention of a CAV that yields."""
        return Intention.SLOWER if self._passing else Intention.STOP

    def _settle_group(
        self,
        tick: int,
        me: str,
        view: PeerView,
        graph: ConflictGraph,
        claims: RightOfWayClaims,
    ) -> None:
        """Settle the group of which the own CAV is a member."""
        group = graph.find_group(me)
        if self._passing:
            before = claims | _find_view_leader_pairs(view)
            order = order_by_urgency(group, {name: graph.get_entry_time(name) for name in group}, before)
            for other in sorted(graph.find_opponents(me)):
                until = tick + graph.count_conflict_ticks((me, other)) + CONFLICT.aftermath_ticks
                self._settled_by_id[other] = order.index(other) < order.index(me), until
            return
        winner = select_winner(group, graph, claims)
        until_all = tick + graph.count_conflict_ticks(group) + CONFLICT.aftermath_ticks
        if winner == me:
            self._settled_by_id |= {name: (False, until_all) for name in group if name != me}
        else:
            self._settled_by_id = {winner: (True, until_all)}

    def _has_original_defect(self, me: str, graph: ConflictGraph, group: tuple[str, ...]) -> bool:
        """Return whether the original would have stopped this CAV by mistake (`compat_ego0`)."""
        if not self._compat_ego0 or me != graph.ids[0]:
            return False
        return bool(graph.in_conflict.any()) and not group

    def _build_terms(
        self, me: NegotiationMember, tick: int, mcm_by_station: Mapping[str, Mcm], claims: RightOfWayClaims
    ) -> NegotiationTerms:
        """Return the terms to announce."""
        decision, answers = self.get_valid_decision(tick), answer_claims(me.id, mcm_by_station, claims)
        if decision is None:
            return NegotiationTerms(answers=answers)
        over = sorted(decision.priority_over)[: MAX_NAMES - 1]
        requests = dict.fromkeys(over, self._waiting_intention) | {me.id: decision.intention}
        return NegotiationTerms(requests, answers, decision.group[:MAX_NAMES], decision.until_tick)


def find_leader_pairs(members: Sequence[NegotiationMember], parameters: LeaderParameters = LEADER) -> RightOfWayClaims:
    """Return (leader, follower) pairs: a member on the path of another one in the same direction must go first."""
    pairs = list_leader_pairs(members, parameters, MAX_STEP_M)
    return frozenset(pair for pair in pairs if pair[::-1] not in pairs)


@twin
def list_leader_pairs(
    members: Sequence[NegotiationMember], parameters: LeaderParameters, max_step_m: float, /
) -> list[tuple[str, str]]:
    """Return all pairs of different members of which the first is on the path of the second, in the same direction.

    max_step_m: largest distance [m] between points of a path that are compared.
    """
    pairs: list[tuple[str, str]] = []
    for follower in members:
        line = densify(np.vstack(((follower.x, follower.y), follower.desired)), max_step_m)
        cos, sin = portable.cos_sin(follower.yaw)
        for leader in members:
            if leader is follower or portable.cos(leader.yaw - follower.yaw) < parameters.same_direction_cos:
                continue
            gaps = portable.hypot(line[:, 0] - leader.x, line[:, 1] - leader.y)
            ahead = cos * (leader.x - follower.x) + sin * (leader.y - follower.y)
            if ahead > 0 and gaps.min() < parameters.max_lateral_m:
                pairs.append((leader.id, follower.id))
    return pairs


@lru_cache(maxsize=CACHED_VIEWS)
def _build_view_graph(view: PeerView) -> ConflictGraph:
    """Return the graph of the desired trajectories of a view: equal for all CAVs that received the same MCMs."""
    return build_conflict_graph(predict_view(view))


@lru_cache(maxsize=CACHED_VIEWS)
def _find_view_leader_pairs(view: PeerView) -> RightOfWayClaims:
    """Return the (leader, follower) pairs of a view."""
    return find_leader_pairs(predict_view(view))
