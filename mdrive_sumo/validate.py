"""Is a suite sound, difficult and solvable? What `mdrive-sumo validate` reports.

Sound: routes follow connected lanes, no CAV starts inside another one or a building. Difficult: blind driving at
constant speed has a near miss, as in the paper's screening (protocol 14.2). Solvable: `omniscient` reaches DS 100.
The suite `interdrive` is also held against the paper's table of scenario distribution and the number of its
scenarios in which a building or another CAV hides the conflict until late.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import shapely

from mdrive_sumo.certificate import DRIVES, Certificate, Drive, certify
from mdrive_sumo.episode import Episode
from mdrive_sumo.errors import InputError
from mdrive_sumo.geometry import box_corners
from mdrive_sumo.loop import VEHICLE
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.catalog import Suite
from mdrive_sumo.scenario.spec import Scenario
from mdrive_sumo.scenario.statistics import PAPER, statistics
from mdrive_sumo.score import ScoreMode, score_episode
from mdrive_sumo.seeding import derived_seed
from mdrive_sumo.soundness import check_scenario
from mdrive_sumo.suite.job import Job, prepared, reexecute
from mdrive_sumo.suite.pool import Pool, WorkerFailure

NEAR_MISS_TTC_S = 0.9
"""Blind driving must come closer to a collision than this (paper, CR; protocol 14.2)."""
FULL_SCORE = 100.0
LEAST_HIDDEN = 15
"""Of the 46 scenarios of `interdrive`."""
TOLERANCE = 0.05
MEANS = {"CAVs": "mean_cavs", "route [m]": "mean_route_m", "heading change [deg]": "mean_heading_change_deg"}
"""Fields of `SuiteStatistics` in which a suite shall be like the paper's."""
LIMIT_S = 300.0
"""Wall clock for one scenario."""


@dataclass(frozen=True, slots=True)
class Question:
    """A scenario to examine; plain values, so that it can be sent to a worker process."""

    suite_folder: str
    scenario: str


@dataclass(frozen=True, slots=True)
class Examination:
    """What was found in a scenario; it passes if `problems` is empty."""

    scenario: str
    problems: tuple[str, ...]
    blind_ttc_s: float | None = None
    """Least time to collision of constant-speed driving; None: never within 1.8 s, or not driven."""
    omniscient_ds: float | None = None
    certificate: Certificate | None = None
    """Where somebody is hidden from a CAV on the way to a conflict; None if it was not driven."""

    @property
    def hidden(self) -> bool:
        """Whether a conflict is hidden until late, see `certificate.Hidden.matters`."""
        return self.certificate is not None and self.certificate.occluded


def sampled(suite: Suite, size: int | None) -> tuple[Scenario, ...]:
    """All scenarios of a suite, or `size` of them: always the same ones, in the order of the suite."""
    drawn = sorted(suite.scenarios, key=lambda scenario: derived_seed(0, scenario.id, "validate"))[:size]
    return tuple(scenario for scenario in suite.scenarios if scenario in drawn)


def examine_suite(suite: Suite, scenarios: Sequence[Scenario], workers: int) -> Iterator[Examination]:
    """Examines scenarios of a suite in worker processes; they come in the order in which they finish."""
    questions = [Question(str(suite.folder.resolve()), scenario.id) for scenario in scenarios]
    with Pool[Question, Examination](examine, min(workers, len(questions)), LIMIT_S) as pool:
        for question, found in pool.run(questions):
            failed = isinstance(found, WorkerFailure)
            yield Examination(question.scenario, (found.reason,)) if failed else found


def examine(question: Question) -> Examination:
    """Drives a scenario blind and omniscient and says what is wrong with it. Raises WorldError."""
    blind = _job(question, "constant-speed")
    scenario, roads = prepared(blind)
    unsound = tuple(_unsound(scenario, roads))
    if unsound:
        return Examination(scenario.id, unsound)
    drives: dict[Drive, Episode] = {drive: reexecute(_job(question, drive)) for drive in DRIVES}
    scores = {d: score_episode(episode, scenario, roads, ScoreMode.MDRIVE, blind.seed) for d, episode in drives.items()}
    ttc, ds = scores["constant-speed"].min_ttc, scores["omniscient"].ds
    problems: list[str] = []
    if ttc is None or ttc >= NEAR_MISS_TTC_S:
        problems.append(f"not difficult: expected a blind TTC below {NEAR_MISS_TTC_S} s, found {_shown(ttc)}")
    if ds < FULL_SCORE:
        problems.append(f"not solvable: expected omniscient to reach DS {FULL_SCORE:g}, found {ds:.2f}")
    return Examination(scenario.id, tuple(problems), ttc, ds, _certificate(question, drives))


def _shown(ttc: float | None) -> str:
    return "none" if ttc is None else f"{ttc:.2f} s"


def _job(question: Question, agent: str) -> Job:
    return Job(question.suite_folder, question.scenario, agent, {}, 0, ScoreMode.MDRIVE)


def _unsound(scenario: Scenario, roads: RoadMap) -> Iterator[str]:
    try:
        check_scenario(scenario, roads)
    except InputError as error:
        yield str(error)
    poses = {ego.id: ego.start for ego in scenario.egos}
    boxes = {
        name: shapely.Polygon(box_corners(pose.x, pose.y, pose.yaw, VEHICLE.length, VEHICLE.width))
        for name, pose in poses.items()
    }
    for one, other in combinations(boxes, 2):
        if boxes[one].intersects(boxes[other]):
            yield f"CAVs {one} and {other} start inside each other"
    for name, box in boxes.items():
        if any(box.intersects(building) for building in roads.building_shapes):
            yield f"CAV {name} starts inside a building"


def _certificate(question: Question, drives: Mapping[Drive, Episode]) -> Certificate:
    scenario, roads = prepared(_job(question, "omniscient"))
    hidden = (interval for drive, episode in drives.items() for interval in certify(drive, episode, scenario, roads))
    return Certificate(scenario=question.scenario, hidden=tuple(hidden))


def suite_problems(suite: Suite, examinations: Sequence[Examination]) -> tuple[str, ...]:
    """What is wrong with a suite as a whole; asked of the paper's suites only.

    The number of hidden conflicts is asked for if every scenario was examined.
    """
    if suite.name not in PAPER:
        return ()
    found, paper = statistics(suite.scenarios), PAPER[suite.name]
    problems = [
        f"{what}: expected {wanted:g} (+-{TOLERANCE:.0%}) on average, found {mean:.2f}"
        for what, field in MEANS.items()
        if abs((mean := getattr(found, field)) / (wanted := getattr(paper, field)) - 1) > TOLERANCE
    ]
    if found.scenarios != paper.scenarios:
        problems.append(f"expected {paper.scenarios} scenarios, found {found.scenarios}")
    hidden = sum(examination.hidden for examination in examinations)
    if len(examinations) == found.scenarios and hidden < LEAST_HIDDEN:
        problems.append(f"expected {LEAST_HIDDEN} conflicts or more that are hidden until late, found {hidden}")
    return tuple(problems)
