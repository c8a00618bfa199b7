"""Recipes of the hard tier: a family on a drawn place, its values and seed, and the measured time limits of the CAVs.

They are stored beside each scenario. With them `generate --rebuild` makes it again byte for byte, without any drive.
"""

import re
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.core.suggestion import describe_unknown
from mdrive_sumo.generate.hard import families
from mdrive_sumo.generate.hard.family import FamilyCandidate, ScenarioFamily, check_candidate
from mdrive_sumo.generate.hard.time_limits import LEAST_FACTOR, MOST_FACTOR, set_time_limits
from mdrive_sumo.generate.rejection import PipelineStage, reject_at
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario, describe_first_error, load_scenario, save_scenario
from mdrive_sumo.scenario.scenario_part import Identifier
from mdrive_sumo.scenario.suite import SCENARIO_FILE
from mdrive_sumo.worlds.places.place_files import PlaceFile

HARD_GENERATOR = 6
"""Version of the families, incremented whenever the same recipe would make another scenario. 3 is that of `hard@0`,
4 and 5 those of trials that are not packaged."""
FIRST_EDITION = "mdrive-sumo/hard-recipe/1"
"""Format of the recipes of `hard@0`, whose families stood on networks made by hand."""
FIRST_EDITION_SOURCE = "commit a14fdf0a"
"""The last one with those families, from which it was made."""


class HardRecipe(BaseModel):
    """The same recipe makes the same scenario with the same version of the families."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)

    format: Literal["mdrive-sumo/hard-recipe/2"] = "mdrive-sumo/hard-recipe/2"
    generator: int = HARD_GENERATOR
    id: Identifier
    family: Identifier
    place: PlaceFile
    """What its network is drawn from."""
    values: tuple[Annotated[float, Field(allow_inf_nan=False)], ...]
    """One for each parameter of the family, in their order."""
    seed: str = Field(min_length=1, max_length=200)
    """Of all that the values leave open."""
    limit_factor: float = Field(ge=LEAST_FACTOR, le=MOST_FACTOR)
    """What the times of `omniscient` are multiplied by for the time limits."""
    time_limits_s: Mapping[str, Annotated[float, Field(gt=0, allow_inf_nan=False)]]
    """Time limit [s] by CAV id, see `hard.time_limits`."""


def is_hard_recipe(path: Path) -> bool:
    """Return whether a recipe file is one of the hard tier, also one of a version that cannot be read."""
    try:
        return b'"mdrive-sumo/hard-recipe/' in read_bytes(path)[:200]
    except OSError:
        return False


def load_hard_recipe(path: Path) -> HardRecipe:
    """Read a recipe; raises InputError, also for one of another version of the families."""
    try:
        text = read_bytes(path)
        if f'"{FIRST_EDITION}"'.encode() in text[:200]:
            raise InputError(_describe_first_edition(path, text))
        recipe = HardRecipe.model_validate_json(text)
    except OSError as error:
        raise InputError(f"{path}: expected a recipe to read, found none: {error.strerror}") from None
    except ValidationError as error:
        raise InputError(f"{path}: {describe_first_error(error)}") from None
    if recipe.generator != HARD_GENERATOR:
        raise InputError(f"{path}: expected version {HARD_GENERATOR} of the families, found {recipe.generator}")
    return recipe


def _describe_first_edition(path: Path, text: bytes) -> str:
    version = re.search(rb'"generator":\s*([0-9]{1,4})', text)
    return (
        f"{path}: expected version {HARD_GENERATOR} of the families of the hard tier,"
        f" found {version[1].decode() if version else 'an unknown one'}, whose scenarios {FIRST_EDITION_SOURCE} makes"
        " again; `hard@0` is packaged as it is"
    )


def find_families(names: Sequence[str] = ()) -> tuple[ScenarioFamily, ...]:
    """Return the families with these names, or all, in the order of the registry. Raises InputError for an unknown
    one."""
    for name in names:
        if name not in families.FAMILIES:
            raise InputError(f"family: {describe_unknown(name, families.FAMILIES)}")
    return tuple(one for name, one in families.FAMILIES.items() if not names or name in names)


def build_hard_scenario(recipe: HardRecipe, roads: RoadMap) -> Scenario:
    """Return the scenario of a recipe on its place, with its time limits, as it is read from its file.

    Raises InputError for an unknown family, values out of bounds and limits of other CAVs, ProposalRejected where the
    family rejects the candidate.
    """
    (family,) = find_families((recipe.family,))
    candidate = FamilyCandidate(recipe.id, roads.name, recipe.values, recipe.seed)
    scenario = build_candidate(family, candidate, roads)
    if (found := set(recipe.time_limits_s)) != (expected := {ego.id for ego in scenario.egos}):
        raise InputError(
            f"recipe {recipe.id}: time_limits_s: expected one for each of the CAVs {', '.join(sorted(expected))},"
            f" found {', '.join(sorted(found)) or 'none'}"
        )
    return set_time_limits(scenario, recipe.time_limits_s)


def build_candidate(family: ScenarioFamily, candidate: FamilyCandidate, roads: RoadMap) -> Scenario:
    """Return the scenario of a candidate, without time limits, as it is read from its file.

    Files hold rounded coordinates: what the search drives is what a suite will hold. Raises ProposalRejected.
    """
    check_candidate(family, candidate)
    with reject_at(PipelineStage.SPAWNS):
        built = family.build(candidate, roads)
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / SCENARIO_FILE
        save_scenario(built, path)
        return load_scenario(path)
