"""SteeredAgent: drives as `sharing+negotiation`, says what it knows, and can be given an order of passing."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from mdrive_sumo.agents.sharing import SharingNegotiationAgent
from mdrive_sumo.contract import Briefing, Observation, Reply
from mdrive_sumo.contract.briefing import V2xRate
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.learning.perturbation import PerturbationSchedule
from mdrive_sumo.negotiation import NegotiationInterface, RuleNegotiator
from mdrive_sumo.negotiation.agreement import find_exits, release_passed
from mdrive_sumo.negotiation.dialogue.dialogue_view import DialogueView, OwnKnowledge, build_dialogue_view
from mdrive_sumo.negotiation.negotiator import NegotiationDecision, NegotiationMember
from mdrive_sumo.negotiation.peer_table import PeerView, predict_view
from mdrive_sumo.negotiation.right_of_way_claims import RightOfWayClaims
from mdrive_sumo.negotiation.rule_negotiator import find_leader_pairs


class SteeredNegotiator(RuleNegotiator):
    """Settles conflicts by the rule `passing`; a decision from outside replaces the rule while it is in force."""

    def __init__(self, rate: V2xRate) -> None:
        super().__init__(passing=True, rate=rate)
        self._given: NegotiationDecision | None = None
        self._exits: Mapping[str, Float] = {}

    def steer(self, me: str, members: Sequence[NegotiationMember], decision: NegotiationDecision) -> None:
        """Follow a decision while it is in force, until those that go first have passed, and claim what it says.

        me: the own station. members: of the group, now.
        """
        self._given = self._decision = decision
        self._exits = find_exits(me, members, decision.yield_to)
        pairs = [(name, True) for name in decision.yield_to] + [(name, False) for name in decision.priority_over]
        self._settled_by_id = {name: (goes_first, decision.until_tick) for name, goes_first in pairs}

    def _update_decision(self, tick: int, me: str, view: PeerView, claims: RightOfWayClaims) -> None:
        if self._given is not None and tick <= self._given.until_tick:
            self._given = self._decision = release_passed(self._given, me, predict_view(view), self._exits)
            if self._given is not None:
                return
            self._settled_by_id.clear()
        super()._update_decision(tick, me, view, claims)


class SteeredAgent(SharingNegotiationAgent):
    """One CAV of a drive in which situations are recorded."""

    def __init__(self, perturbation_seed: int, perturbation: float) -> None:
        super().__init__({})
        self._schedule = PerturbationSchedule(perturbation_seed, perturbation)

    def start(self, briefing: Briefing) -> None:
        """Prepare as `sharing+negotiation` does, with a negotiator that can be steered."""
        super().start(briefing)
        self.negotiator = SteeredNegotiator(briefing.v2x_rate)
        self._negotiation = NegotiationInterface(briefing, self.negotiator, stops=False)
        self._seen: Observation | None = None

    @property
    def station(self) -> str:
        """The id under which it sends."""
        return self._briefing.ego_id

    def act(self, seen: Observation) -> Reply:
        """Return the reply of `sharing+negotiation`; in a perturbation the car does something else."""
        reply, self._seen = super().act(seen), seen
        burst = self._schedule.find_burst(seen.tick)
        if burst is None or reply.plan is None:
            return reply
        return replace(reply, plan=burst.apply(reply.plan, seen.own, seen.tick))

    def describe(
        self, members: Sequence[NegotiationMember], letter_by_station: Mapping[str, str]
    ) -> DialogueView | None:
        """Return what it knows of its group since its last observation; None before it has planned."""
        if self._seen is None or self._ego_planner is None:
            return None
        planner = self._ego_planner.planner
        known = OwnKnowledge.gather(self._briefing, self._seen, planner.s, planner.reason, self._tracker)
        return build_dialogue_view(self.station, members, letter_by_station, find_leader_pairs(members), known)
