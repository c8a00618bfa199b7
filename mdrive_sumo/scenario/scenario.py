"""The scenario file: JSON checked by pydantic, unknown keys refused.

Coordinates are the SUMO network's frame after its netOffset: metres, radians counter-clockwise from +x; a pose is the
box centre.
"""

import json
import math
from pathlib import Path
from typing import Annotated, Literal, TypeVar

import numpy as np
from pydantic import BaseModel, Field, PrivateAttr, ValidationError, model_validator

from mdrive_sumo.core import portable
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.core.output_files import make_parents, write_text
from mdrive_sumo.scenario.background import Background
from mdrive_sumo.scenario.scenario_part import Coordinate, Identifier, Point, Pose, ScenarioPart, Speed
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.scenario.weather import WeatherName

FORMAT = "mdrive-sumo/scenario/1"

ModelT = TypeVar("ModelT", bound=BaseModel)

SpeedRule = Literal["protocol", "road"]
SignalRule = Literal["frozen-green", "program"]
"""`program`: traffic lights run; `frozen-green`: all of them are green, as in the paper's suites."""
TimeLimit = Annotated[float, Field(gt=0, le=3600, allow_inf_nan=False)]


def _is_unset(value: float | None) -> bool:
    """Return whether an optional field has its default: then it is left out of files and checksums."""
    return value is None


def _is_protocol(value: SpeedRule) -> bool:
    """Return whether the speed rule is the default: then it is left out of files and checksums."""
    return value == "protocol"


def _is_empty(names: tuple[str, ...]) -> bool:
    """Return whether an optional list is empty: then it is left out of files and checksums."""
    return not names


def _is_nowhere(value: "CommonStartShift | None") -> bool:
    """Return whether CAVs start together as written: then the range is left out of files and checksums."""
    return value is None


class CommonStartShift(ScenarioPart):
    """How far all CAVs together may start from what is written, along their routes, in worlds of seeds other than 0.

    All start further back, or all further ahead, by the same length: those that meet still meet at the same time.
    """

    back_m: float = Field(ge=0, le=50, allow_inf_nan=False)
    ahead_m: float = Field(ge=0, le=50, allow_inf_nan=False)


class Ego(ScenarioPart):
    """One CAV: its pose at tick 0 and its assigned route."""

    id: Identifier
    start: Pose
    start_speed: Speed = 0.0
    """[m/s]; 0 as in the original, or that of a log."""
    time_limit_s: TimeLimit | None = Field(default=None, exclude_if=_is_unset)
    """Time limit [s] of this CAV; without one that of the protocol (7.6)."""
    lanes: tuple[str, ...] = Field(min_length=1)
    """SUMO lane ids in driving order, junction-internal lanes included; a lane change lists both lanes."""
    route: tuple[Point, ...] = Field(min_length=2)
    """Dense points (x, y, yaw of the assigned lane), 1 m apart; the last hop may be shorter."""

    @property
    def xy(self) -> Float:
        """Route points (N, 2) [m]."""
        return np.array([point[:2] for point in self.route])

    @property
    def yaw(self) -> Float:
        """Lane direction (N,) [rad] at the route points."""
        return np.array([point[2] for point in self.route])

    @model_validator(mode="after")
    def _check_spacing(self) -> "Ego":
        hops = portable.hypot(*np.diff(self.xy, axis=0).T)
        worst = int(np.argmax(hops))
        if hops[worst] > 1.5 or hops.min() <= 0.0:
            raise ValueError(
                f"route of {self.id}: expected points 1 m apart (over 0, at most 1.5 m),"
                f" found {hops[worst]:.2f} m after point {worst} (least {hops.min():.3f} m)"
            )
        return self


class RoadsideUnit(ScenarioPart):
    """A road-side unit that sends its detections as CPM; it has an objects sensor of the given profile."""

    id: Identifier
    x: Coordinate
    y: Coordinate
    range_m: float = Field(default=80.0, gt=0, le=300)
    profile: str = "ideal"
    """Error profile of its detections, see docs/detections.md."""


class Scenario(ScenarioPart):
    """One closed-loop episode: map, CAVs with routes, traffic, conditions."""

    format: Literal["mdrive-sumo/scenario/1"] = FORMAT
    id: Identifier
    bucket: Identifier
    category: Identifier
    network: str = Field(min_length=1)
    """Name of a network: a folder of the suite's own `networks/`, else of the packaged ones."""
    description: str = ""
    signals: SignalRule = "frozen-green"
    speeds: SpeedRule = Field(default="protocol", exclude_if=_is_protocol)
    """Desired speed of CAVs: `protocol`: 8 m/s as in the original; `road`: the speed limits of their lanes."""
    egos: tuple[Ego, ...] = Field(min_length=1, max_length=32)
    start_shift: CommonStartShift | None = Field(default=None, exclude_if=_is_nowhere)
    """Shift of all starts together by the seed, beside that of each CAV (`scenario.start_variation`)."""
    background: Background = Background()
    actors: tuple[Actor, ...] = ()
    """Scripted road users and props."""
    absent: tuple[Identifier, ...] = Field(default=(), exclude_if=_is_empty)
    """Actors and background vehicles that are not there, though a seed draws the world as if they were: those that a
    twin lacks (decision 093)."""
    weather: WeatherName = "default"
    rsus: tuple[RoadsideUnit, ...] = ()
    notes: tuple[str, ...] = ()
    _written: "Scenario | None" = PrivateAttr(default=None)

    @property
    def as_written(self) -> "Scenario":
        """The scenario of the file: itself, unless a seed drew it (`scenario.variation`)."""
        return self._written or self

    def derive(self, **changes: object) -> "Scenario":
        """Return a copy with changed fields, unchecked, that keeps the scenario as written and so its time limit."""
        derived = self.model_copy(update=changes)
        derived._written = self.as_written
        return derived

    def __repr__(self) -> str:
        return (
            f"Scenario({self.id!r}, {self.bucket}, {self.category}, {len(self.egos)} CAVs, {len(self.actors)} actors)"
        )

    @model_validator(mode="after")
    def _check_unique_ids(self) -> "Scenario":
        ids = [one.id for one in (*self.egos, *self.background.vehicles, *self.actors, *self.rsus)]
        if len(set(ids)) < len(ids):
            twice = sorted({i for i in ids if ids.count(i) > 1})
            raise ValueError(f"expected every road user to have its own id, found twice: {', '.join(twice)}")
        return self

    @model_validator(mode="after")
    def _check_absent(self) -> "Scenario":
        known = {one.id for one in (*self.background.vehicles, *self.actors)}
        if unknown := sorted(set(self.absent) - known):
            raise ValueError(f"absent: expected ids of actors or background vehicles, found {unknown[0]!r}")
        return self

    @model_validator(mode="after")
    def _check_referenced_cavs(self) -> "Scenario":
        cavs = [ego.id for ego in self.egos]
        for actor in self.actors:
            for name in actor.referenced_cav_ids:
                if name not in cavs:
                    raise ValueError(f"actor {actor.id}: expected one of the CAVs {', '.join(cavs)}, found {name!r}")
        return self


def load_scenario(path: Path) -> Scenario:
    """Load a scenario file. Raises InputError with one sentence."""
    return load_model(path, Scenario)


def load_model(path: Path, model: type[ModelT]) -> ModelT:
    """Load a JSON file as a pydantic model. Raises InputError with one sentence."""
    try:
        return model.model_validate_json(read_bytes(path))
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except ValidationError as error:
        raise InputError(f"{path}: {describe_first_error(error)}") from None


def save_scenario(scenario: Scenario, path: Path) -> None:
    """Write a scenario file, coordinates rounded to 1 mm and 0.1 mrad, one route point a line."""
    data = scenario.model_dump(mode="json", exclude_defaults=False)
    for ego in data["egos"]:
        ego["start"] = {
            "x": round(ego["start"]["x"], 3),
            "y": round(ego["start"]["y"], 3),
            "yaw": round(ego["start"]["yaw"], 4),
        }
        ego["route"] = [(round(x, 3), round(y, 3), round(yaw, 4)) for x, y, yaw in ego["route"]]
    make_parents(path)
    write_text(path, json.dumps(data, separators=(",", ":")) + "\n")


def describe_first_error(error: ValidationError) -> str:
    """Return the first validation error as one sentence: where, expected, found."""
    problem = error.errors(include_url=False)[0]
    where = ".".join(str(part) for part in problem["loc"]) or "the file"
    more = f" ({error.error_count() - 1} more)" if error.error_count() > 1 else ""
    given = (
        ""
        if problem["type"] in ("missing", "json_invalid", "value_error")
        else f", found {shorten_value(problem['input'])}"
    )
    # In front of the words of validators, and of pydantic's own.
    reason = problem["msg"].removeprefix("Value error, ").replace("Input should be ", "expected ", 1)
    return f"{where}: {reason}{given}{more}"


def shorten_value(value: object) -> str:
    """Return a value as text of at most 60 characters."""
    text = "NaN" if isinstance(value, float) and math.isnan(value) else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
