"""Recorded traffic lights as the state of every controlled lane in every tick."""

from dataclasses import dataclass

from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.roads import RoadMap

UNKNOWN = "o"
"""SUMO's letter for a light that is off."""


@dataclass(frozen=True, slots=True)
class LaneSignal:
    """The light at the end of a lane for the way into one successor."""

    lane: str
    successor: str
    states: tuple[str, ...]
    """SUMO's letter of the light in every tick, (T,)."""

    @property
    def phases(self) -> list[tuple[str, int]]:
        """The letters with their numbers of ticks, as they follow each other."""
        phases: list[tuple[str, int]] = []
        for state in self.states:
            if phases and phases[-1][0] == state:
                phases[-1] = (state, phases[-1][1] + 1)
            else:
                phases.append((state, 1))
        return phases


def list_lane_signals(record: EpisodeRecord, roads: RoadMap) -> list[LaneSignal]:
    """Return the signals of all controlled lanes, in the order of `roads.driving`."""
    programs = _expand_programs(record)
    signals: list[LaneSignal] = []
    for lane in roads.driving:
        for successor, link in lane.lights.items():
            light, _, index = link.rpartition(":")
            states = programs.get(light, [""] * record.ticks)
            letters = tuple(state[int(index)] if int(index) < len(state) else UNKNOWN for state in states)
            signals.append(LaneSignal(lane.id, successor, letters))
    return signals


def _expand_programs(record: EpisodeRecord) -> dict[str, list[str]]:
    """Return the state of every traffic light in every tick, "" before its first change."""
    programs = {change.light: [""] * record.ticks for change in record.signals}
    for change in record.signals:
        programs[change.light][change.tick :] = [change.state] * (record.ticks - change.tick)
    return programs
