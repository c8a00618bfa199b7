"""One round of a conversation at a tick of a drive, outside of the drive: nothing that is said changes it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from mdrive_sumo.agents.colmdriver import ColmdriverAgent
from mdrive_sumo.contract.agent_options import Config
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.learning.drive_episode import LiveDrive, open_drive
from mdrive_sumo.loop import EpisodeConfig
from mdrive_sumo.negotiation import NegotiationMember
from mdrive_sumo.negotiation.conflict_graph import STEP_TICKS, build_conflict_graph
from mdrive_sumo.negotiation.conversation import Conversation, compute_speaking_order
from mdrive_sumo.negotiation.dialogue.answers import MAX_MEMBERS
from mdrive_sumo.negotiation.speaker import GroupAgreement, Speaker

MOST_TICKS = 3
"""That a sentence suggests."""


@dataclass(frozen=True)
class TickGroup:
    """A group in conflict at a tick, as all of its members see it."""

    conversation: Conversation
    """Nothing has been said yet."""
    members: Mapping[str, NegotiationMember]
    """By station."""
    speakers: Mapping[str, Speaker]
    """By station."""
    cav_by_station: Mapping[str, str]


def find_group(config: EpisodeConfig, options: Config, tick: int, cav: str | None) -> TickGroup:
    """Return the group at a tick of a drive with `colmdriver`; of several that of a CAV, or the first.

    options: of the agent. Raises InputError for a tick without such a group, and WorldError.
    """
    agents = {ego.id: ColmdriverAgent(options) for ego in config.scenario.egos}
    place = f"scenario {config.scenario.id}: tick {tick}"
    other_ticks: list[int] = []
    with open_drive(config, agents) as drive:
        while not drive.simulation.is_done:
            drive.step()
            now = drive.simulation.tick
            if drive.simulation.is_done or (now != tick and now % STEP_TICKS):
                continue
            groups = _list_groups(drive, agents, config)
            chosen = [group for group in groups if cav is None or cav in group.cav_by_station.values()]
            if now == tick and chosen:
                return chosen[0]
            other_ticks += [now] if chosen and now != tick else []
    whose = "CAVs" if cav is None else f"CAV {cav}"
    if not other_ticks:
        raise InputError(f"{place}: expected {whose} in conflict with others, found none in the whole drive")
    later = [one for one in other_ticks if one >= tick] or other_ticks
    ticks = ", ".join(map(str, later[:MOST_TICKS]))
    raise InputError(f"{place}: expected a tick with {whose} in conflict, such as {ticks}; found none there")


def _list_groups(drive: LiveDrive, agents: Mapping[str, ColmdriverAgent], config: EpisodeConfig) -> list[TickGroup]:
    """Return the groups at the present tick, by station."""
    tick, cavs = drive.simulation.tick, {config.pseudonyms[cav]: cav for cav in drive.simulation.active_egos}
    groups: dict[tuple[str, ...], TickGroup] = {}
    for station, cav in sorted(cavs.items()):
        negotiator = agents[cav].negotiator
        everyone = negotiator.peers.predict_members(tick) if negotiator is not None else ()
        graph = build_conflict_graph(everyone)
        group = graph.find_group(station) if station in graph.ids else ()
        if not 1 < len(group) <= MAX_MEMBERS or group in groups or not set(group) <= set(cavs):
            continue
        members = {member.id: member for member in everyone if member.id in group}
        order = compute_speaking_order(tuple(members.values()))
        speakers = {name: agents[cavs[name]].speaker for name in group}
        present = {name: speaker for name, speaker in speakers.items() if speaker is not None}
        names = {name: cavs[name] for name in group}
        groups[group] = TickGroup(Conversation(group, order, tick), members, present, names)
    return list(groups.values())


def hold_round(
    group: TickGroup, replies: Mapping[str, Callable[[], str]], tell: Callable[[str, str], None]
) -> GroupAgreement | None:
    """Let all members speak once; return what the most central one says was agreed, None if it has nothing usable.

    replies: what says the message of a member instead of its speaker, by station. tell: is told (station, message).
    """
    conversation = group.conversation
    for station in conversation.order:
        reply = replies.get(station)
        text = group.speakers[station].say(conversation, station, group.members) if reply is None else reply()
        conversation.text_by_turn[conversation.round, station] = text or ""
        tell(station, text or "")
    central = conversation.order[0]
    return group.speakers[central].conclude(conversation, central, group.members)
