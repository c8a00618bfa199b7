"""The pool of drawn places of a season of the hard tier, on which its families are staged.

For each kind of place that a family asks for a few are drawn, from the season's seed and that kind alone: further
families extend a pool and change nothing in it. Families that ask for the same kind share its places.
"""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate.drawn_places import DRAWS, PlaceChoice, compile_place, describe_place
from mdrive_sumo.generate.hard.family import ScenarioFamily
from mdrive_sumo.roads import RoadMap, load_road_map
from mdrive_sumo.runs.process_pool import FailureKind, ProcessPool, WorkerFailure
from mdrive_sumo.worlds.places import PLACE_KINDS, check_place, draw_place
from mdrive_sumo.worlds.places.place_files import PlaceFile

PLACES_OF_CHOICE = 4
"""Places of each kind that is asked for: with some twenty kinds three times as many as a season needs at least."""
PLACE_LIMIT_S = 120.0
"""Wall clock for one place: netconvert takes about a second."""


@dataclass(frozen=True, slots=True)
class HardPlace:
    """A drawn place of a season's pool."""

    about: PlaceFile
    choice: str
    """Name of the kind of place that it was drawn for, see `name_choice`."""
    folder: Path
    """Its network; the folder has the name of the place."""

    @property
    def name(self) -> str:
        """Name of its network."""
        return self.folder.name

    def load_roads(self) -> RoadMap:
        """Return its road map."""
        return load_road_map(self.folder)


def name_choice(choice: PlaceChoice) -> str:
    """Return what tells a kind of place from others: `crossing {"arms": 3}`."""
    return f"{choice.kind} {json.dumps(dict(choice.parameters), sort_keys=True)}"


def list_choices(families: Iterable[ScenarioFamily]) -> tuple[PlaceChoice, ...]:
    """Return the distinct kinds of places of families, in their order. Raises InputError for an unknown kind."""
    found = {name_choice(choice): choice for family in families for choice in family.places}
    for choice in found.values():
        if choice.kind not in PLACE_KINDS:
            raise InputError(f"family: places: expected one of {', '.join(PLACE_KINDS)}, found {choice.kind!r}")
    return tuple(found.values())


def find_places(pool: Sequence[HardPlace], family: ScenarioFamily) -> tuple[HardPlace, ...]:
    """Return the places of a pool that a family asks for: the first of each of its kinds, then the second of each."""
    wanted = list(dict.fromkeys(map(name_choice, family.places)))
    of_kind = [[place for place in pool if place.choice == name] for name in wanted]
    rounds = max(map(len, of_kind), default=0)
    return tuple(places[k] for k in range(rounds) for places in of_kind if k < len(places))


@dataclass(frozen=True, slots=True)
class PlaceTask:
    """A place to draw; it can be sent to a worker process."""

    choice: PlaceChoice
    seed: str
    folder: Path
    """Folder in which that of the place is written."""


def draw_pool(
    choices: Sequence[PlaceChoice], seed: str, folder: Path, workers: int, count: int = PLACES_OF_CHOICE
) -> tuple[HardPlace, ...]:
    """Draw `count` places of each kind into `folder`/NAME and return them. Raises InputError without netconvert.

    A place that lies there from an earlier start is not compiled again. A kind of which no draw is sound has fewer.
    """
    tasks = [
        PlaceTask(choice, f"{seed}/{name_choice(choice)}/{number}", folder)
        for number in range(count)
        for choice in choices
    ]
    drawn: list[HardPlace] = []
    with ProcessPool(draw_hard_place, min(workers, len(tasks)), PLACE_LIMIT_S) as pool:
        outcomes = {task.seed: outcome for task, outcome in pool.run(tasks)}
    for task in tasks:  # in their order, not in that in which worker processes end
        outcome = outcomes[task.seed]
        if isinstance(outcome, WorkerFailure):
            if outcome.kind is FailureKind.INPUT:
                raise InputError(outcome.reason)
            raise InputError(f"place {name_choice(task.choice)}: expected a drawn one, found none: {outcome.reason}")
        if outcome is not None and outcome.name not in {place.name for place in drawn}:
            drawn.append(outcome)
    return tuple(drawn)


def draw_hard_place(task: PlaceTask) -> HardPlace | None:
    """Draw places until one is sound, write it, and return it; None if none of `DRAWS` is."""
    for number in range(DRAWS):
        place = draw_place(task.choice.kind, f"{task.seed}-{number}", **task.choice.parameters)
        if not check_place(compile_place(place, task.folder)):
            return HardPlace(describe_place(place), name_choice(task.choice), task.folder / place.name)
    return None
