"""Screens a scenario for difficulty and feasibility: blind driving must come close to a collision, `omniscient` must
succeed (protocol 14.2)."""

from dataclasses import dataclass

from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.generate.built_in_drive import SEED, drive_episode
from mdrive_sumo.generate.validation import FULL_SCORE, NEAR_MISS_TTC_S
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scoring import ScenarioResult, ScoreMode, score_episode
from mdrive_sumo.study.occlusion_certificate import ReferenceDrive, find_occluded_intervals


@dataclass(frozen=True, slots=True)
class ScreeningResult:
    """Figures of both drives."""

    blind_ttc_s: float | None
    """Least time to collision of blind driving; None: no dangerous approach."""
    omniscient_ds: float
    is_occluded: bool = False
    """Whether the scenario has an occlusion certificate."""

    @property
    def is_difficult(self) -> bool:
        """Whether blind driving has a near miss (TTC < 0.9 s at closing speeds over 1 m/s)."""
        return self.blind_ttc_s is not None and self.blind_ttc_s < NEAR_MISS_TTC_S

    @property
    def is_feasible(self) -> bool:
        """Whether every CAV can complete its route without an infraction."""
        return self.omniscient_ds >= FULL_SCORE


def screen_scenario(scenario: Scenario, roads: RoadMap) -> ScreeningResult:
    """Drive a scenario blindly and, if that is dangerous, with `omniscient`."""
    blind = drive_episode(scenario, roads, "constant-speed")
    ttc = _score(blind, scenario, roads).min_ttc
    if ttc is None or ttc >= NEAR_MISS_TTC_S:
        return ScreeningResult(ttc, 0.0)
    solved = drive_episode(scenario, roads, "omniscient")
    drives: dict[ReferenceDrive, EpisodeRecord] = {"constant-speed": blind, "omniscient": solved}
    hidden = [
        found for drive, episode in drives.items() for found in find_occluded_intervals(drive, episode, scenario, roads)
    ]
    return ScreeningResult(ttc, _score(solved, scenario, roads).ds, any(interval.matters for interval in hidden))


def _score(episode: EpisodeRecord, scenario: Scenario, roads: RoadMap) -> ScenarioResult:
    return score_episode(episode, scenario, roads, ScoreMode.MDRIVE, SEED)
