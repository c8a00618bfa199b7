"""Base model and common field types of scenario files."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Coordinate = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]
Identifier = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.+-]{0,79}$")]
Point = tuple[Coordinate, Coordinate, Coordinate]
Seconds = Annotated[float, Field(ge=0, le=3600, allow_inf_nan=False)]
Speed = Annotated[float, Field(ge=0, le=60, allow_inf_nan=False)]


class ScenarioPart(BaseModel):
    """Base of all models of a scenario file: immutable, unknown keys are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True)


class Pose(ScenarioPart):
    """Box centre [m] and yaw [rad]."""

    x: Coordinate
    y: Coordinate
    yaw: Coordinate
