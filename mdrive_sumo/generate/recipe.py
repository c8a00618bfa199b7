"""Recipes: the inputs of a generated scenario, stored beside it, from which it can be rebuilt byte for byte."""

from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.core.output_files import make_parents, write_text
from mdrive_sumo.generate.proposal import Proposal
from mdrive_sumo.scenario.scenario import SignalRule, describe_first_error
from mdrive_sumo.scenario.scenario_part import Identifier
from mdrive_sumo.scenario.weather import WeatherName
from mdrive_sumo.worlds.places.place_files import PlaceFile

GENERATOR = 1
"""Version of the generator, incremented whenever the same recipe would make another scenario."""
SEASON_GENERATOR = 2
"""The same for recipes with a place. 2: routes of InterDrive are shorter, and lights may run."""


class Recipe(BaseModel):
    """The same recipe makes the same scenario with the same version of the generator."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: Literal["mdrive-sumo/recipe/1"] = "mdrive-sumo/recipe/1"
    generator: int = GENERATOR
    id: Identifier
    seed: str = Field(min_length=1, max_length=200)
    """Seed of everything after the proposal: network, lane routes, starts."""
    proposer: str = "template"
    """`template`, or `llm:MODEL`."""
    weather: WeatherName = "default"
    proposal: Proposal
    signals: SignalRule = Field(default="frozen-green", exclude_if=lambda signals: signals == "frozen-green")
    place: PlaceFile | None = Field(default=None, exclude_if=lambda place: place is None)
    """The place of a season's scenario, from which its network is drawn again; None: a packaged network."""


def load_recipe(path: Path) -> Recipe:
    """Read a recipe; raises InputError, also for one of another version of the generator."""
    try:
        recipe = Recipe.model_validate_json(read_bytes(path))
    except OSError as error:
        raise InputError(f"{path}: expected a recipe to read, found none: {error.strerror}") from None
    except ValidationError as error:
        raise InputError(f"{path}: {describe_first_error(error)}") from None
    version = SEASON_GENERATOR if recipe.place else GENERATOR
    if recipe.generator != version:
        raise InputError(f"{path}: expected version {version} of the generator, found {recipe.generator}")
    return recipe


def save_recipe(recipe: BaseModel, path: Path) -> None:
    """Write a recipe."""
    make_parents(path)
    write_text(path, recipe.model_dump_json(exclude_defaults=False) + "\n")
