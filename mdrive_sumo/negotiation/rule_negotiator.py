"""The rule: whoever is nearest to the conflict goes first (protocol 10.5)."""

from collections.abc import Sequence

import numpy as np

from mdrive_sumo.contract import Message
from mdrive_sumo.negotiation.conflict_graph import (
    AFTERMATH_TICKS,
    ConflictGraph,
    build_conflict_graph,
    find_next_planning_tick,
)
from mdrive_sumo.negotiation.intention import replace_slow_keep
from mdrive_sumo.negotiation.negotiator import NegotiationDecision, NegotiationMember, NegotiationStep
from mdrive_sumo.negotiation.peer_table import PeerTable
from mdrive_sumo.negotiation.right_of_way_claims import (
    NegotiationTerms,
    RightOfWayClaims,
    answer_claims,
    build_mcm_message,
    collect_claims,
)
from mdrive_sumo.planning.precedence import order_by_urgency
from mdrive_sumo.v2x.messages import MAX_NAMES, Intention, Mcm


def select_winner(group: Sequence[str], graph: ConflictGraph, claims: RightOfWayClaims = frozenset()) -> str:
    """Who goes first: of those who claim it already, else of all, the nearest to its conflict, then the smallest id."""
    beaten = {second for first, second in claims if first in group}
    claimants = {first for first, second in claims if second in group and first in group} - beaten
    return min(claimants or group, key=lambda name: (graph.get_distance_to_conflict(name), name))


def choose_winner_intention(member: NegotiationMember) -> Intention:
    """What one who goes first does: what it means to do, but it neither stops nor keeps a low speed."""
    return Intention.FASTER if member.intention == Intention.STOP else replace_slow_keep(member.intention, member.speed)


def apply_rule(
    members: Sequence[NegotiationMember], graph: ConflictGraph, group: Sequence[str]
) -> dict[str, Intention]:
    """What the rule has everybody in a group do: the winner goes, all others stop."""
    winner = select_winner(group, graph)
    return {m.id: choose_winner_intention(m) if m.id == winner else Intention.STOP for m in members if m.id in group}


class RuleNegotiator:
    """Every CAV applies the rule to its own view of the same MCMs, and says in its own MCM what it makes of it.

    Who goes first is settled once for a conflict: as long as a claim holds it is not settled anew, though the winner
    may not be the nearest any more. `passing`: the others do not stop, they line up by when they would come to where
    their ways meet, and pass one behind the other.
    `compat_ego0`: the original's slip, see protocol 10.5: the first station of all has to stop when it is in a decision
    of its own while others negotiate without it.
    """

    def __init__(self, passing: bool = False, compat_ego0: bool = False) -> None:
        self._passing, self._compat_ego0 = passing, compat_ego0
        self.peers = PeerTable()
        self._yields: dict[str, tuple[bool, int]] = {}
        self._decision: NegotiationDecision | None = None
        self._due_tick = 0

    def step(self, tick: int, me: NegotiationMember, heard: Sequence[Message]) -> NegotiationStep:
        """See Negotiator."""
        for message in heard:
            self.peers.receive(message)
        if tick < self._due_tick:
            return NegotiationStep(self._valid(tick))
        self._due_tick = find_next_planning_tick(tick)
        said = self.peers.get_latest_mcms(tick)
        claims = collect_claims(said, tick)
        members = self.peers.predict_members(tick)
        self._settle(tick, me.id, members, claims)
        message = build_mcm_message(me, tick, self._terms(me, tick, said, claims))
        self.peers.receive(message)
        return NegotiationStep(self._valid(tick), (message,))

    def _valid(self, tick: int) -> NegotiationDecision | None:
        decision = self._decision
        return decision if decision is not None and tick <= decision.until_tick else None

    def _settle(self, tick: int, me: str, members: Sequence[NegotiationMember], claims: RightOfWayClaims) -> None:
        """Brings the decision up to date with this view."""
        graph = build_conflict_graph(members)
        group = graph.find_group(me) if me in graph.ids else ()
        if group:
            self._enter(tick, me, members, graph, claims)
        known = set(graph.ids)
        self._yields = {name: term for name, term in self._yields.items() if term[1] >= tick and name in known}
        first = frozenset(name for name, (yields, _) in self._yields.items() if yields)
        after = frozenset(self._yields) - first
        if not self._yields:
            self._decision = None
            return
        waits = Intention.SLOWER if self._passing else Intention.STOP
        mine = next(m for m in members if m.id == me)
        intention = waits if first or self._slip(me, graph, group) else choose_winner_intention(mine)
        until = max(until for _, until in self._yields.values())
        self._decision = NegotiationDecision(intention, first, after, until, group or (self._decision or _NONE).group)

    def _enter(
        self, tick: int, me: str, members: Sequence[NegotiationMember], graph: ConflictGraph, claims: RightOfWayClaims
    ) -> None:
        """Settles the group that I am in now."""
        group = graph.find_group(me)
        if self._passing:
            before = claims | find_leader_pairs(members)
            order = order_by_urgency(group, {name: graph.get_entry_time(name) for name in group}, before)
            foes = graph.find_opponents(me)
            until = {foe: tick + graph.count_conflict_ticks((me, foe)) + AFTERMATH_TICKS for foe in foes}
            self._yields |= {foe: (order.index(foe) < order.index(me), until[foe]) for foe in sorted(foes)}
            return
        winner = select_winner(group, graph, claims)
        until_all = tick + graph.count_conflict_ticks(group) + AFTERMATH_TICKS
        if winner == me:
            self._yields |= {name: (False, until_all) for name in group if name != me}
        else:
            self._yields = {winner: (True, until_all)}

    def _slip(self, me: str, graph: ConflictGraph, group: tuple[str, ...]) -> bool:
        """Whether the original would have written STOP for me by mistake."""
        if not self._compat_ego0 or me != graph.ids[0]:
            return False
        return bool(graph.in_conflict.any()) and not group

    def _terms(
        self, me: NegotiationMember, tick: int, said: dict[str, Mcm], claims: RightOfWayClaims
    ) -> NegotiationTerms:
        decision = self._valid(tick)
        if decision is None:
            return NegotiationTerms(answers=answer_claims(me.id, said, claims))
        asked = Intention.SLOWER if self._passing else Intention.STOP
        over = sorted(decision.priority_over)[: MAX_NAMES - 1]
        requests = dict.fromkeys(over, asked) | {me.id: decision.intention}
        return NegotiationTerms(
            requests, answer_claims(me.id, said, claims), decision.group[:MAX_NAMES], decision.until_tick
        )


BESIDE_M = 1.5
SAME_WAY_COS = 0.5


def find_leader_pairs(members: Sequence[NegotiationMember]) -> RightOfWayClaims:
    """(leader, follower) pairs: who is on the way of another one that goes in the same direction must go first."""
    found: set[tuple[str, str]] = set()
    for follower in members:
        way = np.vstack(((follower.x, follower.y), follower.desired))
        for leader in members:
            if leader.id == follower.id or np.cos(leader.yaw - follower.yaw) < SAME_WAY_COS:
                continue
            gaps = np.hypot(way[:, 0] - leader.x, way[:, 1] - leader.y)
            ahead = np.cos(follower.yaw) * (leader.x - follower.x) + np.sin(follower.yaw) * (leader.y - follower.y)
            if ahead > 0 and gaps.min() < BESIDE_M:
                found.add((leader.id, follower.id))
    return frozenset(pair for pair in found if pair[::-1] not in found)


_NONE = NegotiationDecision(Intention.KEEP)
