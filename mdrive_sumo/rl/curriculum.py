"""CurriculumStage: what the episodes of an environment are drawn from, until the next stage begins."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, cast

from mdrive_sumo.api.scenario_source import find_scenario
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.suggestion import describe_unknown
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import load_suite


@dataclass(frozen=True)
class CurriculumStage:
    """A part of a curriculum: places are suites of one's own, seasons those of the packaged ones."""

    suite: str = "interdrive@0"
    """Name or folder of the suite that the scenarios belong to."""
    scenarios: Sequence[str] = ()
    """Ids of its scenarios; none: all."""
    density: Sequence[int] = ()
    """Least and greatest number of other road users in a scenario as written, background vehicles and scripted actors;
    none: any."""
    episodes: int = 0
    """Number of episodes of a seed until the next stage; of no account in the last stage, which goes on."""

    @cached_property
    def cav_ids(self) -> Mapping[str, tuple[str, ...]]:
        """Ids of the CAVs by id of scenario, both in the order of the files. Raises InputError."""
        suite = load_suite(self.suite)
        written = [find_scenario(one, suite).scenario for one in self.scenarios] or list(suite)
        cav_ids = {one.id: tuple(ego.id for ego in one.egos) for one in written if self._has_density(one)}
        if not cav_ids:
            low, high = self.density
            raise InputError(
                f"environment: density: expected scenarios with {low} to {high} other road users in {self.suite},"
                " found none"
            )
        return cav_ids

    def _has_density(self, scenario: Scenario) -> bool:
        others = len(scenario.background.vehicles) + len(scenario.actors)
        return not self.density or self.density[0] <= others <= self.density[1]


def read_stages(curriculum: object) -> tuple[CurriculumStage, ...]:
    """Return the stages of a list of mappings with the fields of CurriculumStage. Raises InputError."""
    if not isinstance(curriculum, Sequence) or isinstance(curriculum, str) or not curriculum:
        raise InputError(f"environment: curriculum: expected a list of stages, found {curriculum!r:.40}")
    stages = tuple(_read_stage(number, stage) for number, stage in enumerate(cast("Sequence[object]", curriculum)))
    for number, stage in enumerate(stages[:-1]):
        if isinstance(cast(object, stage.episodes), bool) or stage.episodes < 1:
            raise InputError(
                f"environment: curriculum: stage {number}: episodes: expected at least 1, for another stage follows,"
                f" found {stage.episodes}"
            )
    return stages


def _read_stage(number: int, stage: object) -> CurriculumStage:
    place = f"environment: curriculum: stage {number}"
    if not isinstance(stage, Mapping):
        raise InputError(f"{place}: expected a mapping, found {stage!r:.40}")
    given = cast("Mapping[str, Any]", stage)
    known = [one.name for one in fields(CurriculumStage)]
    for name in given:
        if name not in known:
            raise InputError(f"{place}: {describe_unknown(str(name), known)}")
    read = CurriculumStage(**given)
    if isinstance(cast(object, read.episodes), bool) or not isinstance(cast(object, read.episodes), int):
        raise InputError(f"{place}: episodes: expected an integer, found {read.episodes!r:.40}")
    check_stage(read, place)
    return read


def check_stage(stage: CurriculumStage, place: str) -> None:
    """Raise InputError for scenarios or a density of the wrong kind."""
    if isinstance(cast(object, stage.scenarios), str):
        raise InputError(f"{place}: scenarios: expected a list of ids, found the text {stage.scenarios!r:.40}")
    density = cast(object, stage.density)
    is_range = isinstance(density, Sequence) and all(type(one) is int for one in cast("Sequence[object]", density))
    if not is_range or (stage.density and (len(stage.density) != 2 or stage.density[0] > stage.density[1])):
        raise InputError(f"{place}: density: expected two integers, the least first, found {density!r:.40}")
