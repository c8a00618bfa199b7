"""The situations of one training scenario: groups in conflict while it is driven, with the orders of all teachers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.core.errors import WorldError
from mdrive_sumo.core.seeding import derive_seed, draw_uniforms
from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.learning.collection_settings import CollectionSettings
from mdrive_sumo.learning.dialogue.agreement_search import OrderTrial, simulate_order
from mdrive_sumo.learning.dialogue.situations import OrderOutcome, Situation
from mdrive_sumo.learning.dialogue.steered_agent import SteeredAgent
from mdrive_sumo.learning.dialogue.teachers import (
    Order,
    choose_candidates,
    find_driven_order,
    find_passing_order,
    find_rule_order,
)
from mdrive_sumo.learning.drive_episode import LiveDrive, open_drive
from mdrive_sumo.loop import EpisodeConfig
from mdrive_sumo.negotiation.conflict_graph import STEP_TICKS, build_conflict_graph
from mdrive_sumo.negotiation.conversation import compute_speaking_order
from mdrive_sumo.negotiation.dialogue.answers import MAX_MEMBERS, assign_letters
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario

TEACHER = "omniscient"
"""Expert of a second drive, which tells an order of passing."""


@dataclass(frozen=True, slots=True)
class SituationSampling:
    """Which ticks become situations, and how many of them are searched."""

    interval_ticks: int = TICKS_PER_SECOND
    """Between the first two situations of a group; each pause is twice as long as that before, so that groups in a
    jam are not most of the data."""
    searched: float = 0.35
    """Share of the situations whose orders are simulated, of those that have more than one."""
    settled: float = 0.2
    """Share of the situations that are kept of those with one order, mostly a leader and its followers."""
    most_orders: int = 6
    """Orders that are simulated for one situation."""
    asks_omniscient: bool = True
    """Whether `omniscient` drives the scenario, too."""


def drive_situations(
    settings: CollectionSettings, scenario: Scenario, roads: RoadMap, seed: int, sampling: SituationSampling
) -> list[Situation]:
    """Return the situations of a scenario, in the order of time. Raises WorldError, also if an agent fails."""
    config = EpisodeConfig(scenario, roads, seed)
    teacher = _drive_teacher(config) if sampling.asks_omniscient else None
    agents = {
        ego.id: SteeredAgent(derive_seed(seed, "learning", ego.id), settings.perturbation) for ego in scenario.egos
    }
    situations: list[Situation] = []
    due: dict[Order, int] = {}
    pause: dict[Order, int] = {}
    with open_drive(config, agents) as drive:
        while not drive.simulation.is_done:
            drive.step()
            tick = drive.simulation.tick
            if drive.simulation.is_done or tick % STEP_TICKS:
                continue
            for group in _find_groups(drive, agents):
                if tick >= due.get(group, 0):
                    pause[group] = 2 * pause[group] if group in pause else sampling.interval_ticks
                    due[group] = tick + pause[group]
                    situation = _record(drive, agents, group, _Recording(config, sampling, teacher))
                    situations += [situation] if situation is not None else []
    return situations


@dataclass(frozen=True, slots=True)
class _Recording:
    """What all situations of a drive are recorded with."""

    config: EpisodeConfig
    sampling: SituationSampling
    teacher: EpisodeRecord | None
    """The drive of `TEACHER`."""

    def find_teacher_order(self, group: Sequence[str]) -> Order | None:
        """Return the order of `TEACHER`, if it has driven."""
        if self.teacher is None:
            return None
        cav_by_station = {station: cav for cav, station in self.config.pseudonyms.items()}
        columns = {station: self.teacher.ego_ids.index(cav_by_station[station]) for station in group}
        return find_driven_order(self.teacher, columns)


def _drive_teacher(config: EpisodeConfig) -> EpisodeRecord | None:
    """Return the drive of `TEACHER` in a scenario; None if it fails."""
    agents = {ego.id: AGENTS[TEACHER]({}) for ego in config.scenario.egos}
    try:
        with open_drive(config, agents) as drive:
            while not drive.simulation.is_done:
                drive.step()
    except WorldError:
        return None
    return drive.simulation.finish()


def _find_groups(drive: LiveDrive, agents: Mapping[str, SteeredAgent]) -> list[Order]:
    """Return the groups of stations in conflict that have letters, as all of their members see them."""
    tick, present = drive.simulation.tick, drive.simulation.active_egos
    views: dict[str, Order] = {}
    for cav in present:
        agent = agents[cav]
        members = agent.negotiator.peers.predict_members(tick)
        graph = build_conflict_graph(members)
        views[agent.station] = graph.find_group(agent.station) if agent.station in graph.ids else ()
    groups = sorted(set(views.values()) - {()})
    return [
        group for group in groups if len(group) <= MAX_MEMBERS and all(views.get(station) == group for station in group)
    ]


def _record(
    drive: LiveDrive, agents: Mapping[str, SteeredAgent], group: Order, recording: _Recording
) -> Situation | None:
    """Return the situation of a group; None if a member has not planned yet, or it is left out."""
    scenario, sampling = recording.config.scenario, recording.sampling
    tick, letters = drive.simulation.tick, assign_letters(group)
    by_station = {agent.station: agent for agent in agents.values()}
    everyone = by_station[group[0]].negotiator.peers.predict_members(tick)
    members = [member for member in everyone if member.id in letters]
    views = [by_station[station].describe(members, letters) for station in group]
    known = [view for view in views if view is not None]
    if len(known) < len(group):
        return None
    graph = build_conflict_graph(members)
    orders = {"passing": find_passing_order(members, graph, group), "rule": find_rule_order(graph, group)}
    teacher_order = recording.find_teacher_order(group)
    orders |= {} if teacher_order is None else {TEACHER: teacher_order}
    tried = choose_candidates(members, graph, [*orders.values()], sampling.most_orders)
    keep, search, *_ = draw_uniforms(recording.config.seed, "situation", tick, group[0])
    if len(tried) == 1 and keep >= sampling.settled:
        return None
    outcomes: list[OrderOutcome | None] = []
    if len(tried) > 1 and search < sampling.searched:
        outcomes = [simulate_order(drive, agents, OrderTrial(order, tuple(members)), letters) for order in tried]
    return Situation(
        place=scenario.network,
        scenario=scenario.id,
        tick=tick,
        speakers=_spell(compute_speaking_order(members), letters),
        views=tuple(known),
        orders={teacher: _spell(order, letters) for teacher, order in orders.items()},
        outcomes=tuple(outcome for outcome in outcomes if outcome is not None),
    )


def _spell(order: Sequence[str], letters: Mapping[str, str]) -> str:
    return "".join(letters[station] for station in order)
