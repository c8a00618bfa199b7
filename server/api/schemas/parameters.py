"""Types of path and query parameters, and the base classes of request and response bodies."""

from datetime import UTC, datetime
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field


def to_datetime(at_us: int) -> datetime:
    """Convert microseconds since 1970 to a UTC datetime."""
    return datetime.fromtimestamp(at_us / 1e6, UTC)


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError("printable characters")
    return text


_NO_CONTROLS = Field(json_schema_extra={"pattern": r"^[^\x00-\x1f\x7f-\x9f]*$"})
"""What a regular expression of OpenAPI can say of printable text; `_printable` also refuses code points without a
character."""
TeamName = Annotated[str, Field(min_length=1, max_length=64), AfterValidator(_printable), _NO_CONTROLS]
"""Name of a team, or its id."""
ID_PATTERN, PHASE_PATTERN = r"^[0-9a-f]{32}$", r"^[a-z0-9][a-z0-9-]{0,39}$"
SCENARIO_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9_.+-]{0,79}$"
"""Every pattern has its words in `problems`, which people read instead of it."""
Id = Annotated[str, Field(pattern=ID_PATTERN)]
PhaseId = Annotated[str, Field(pattern=PHASE_PATTERN)]
ScenarioId = Annotated[str, Field(pattern=SCENARIO_PATTERN)]
"""Id of a scenario as in its file, or of a CAV."""
SearchText = Annotated[str, Field(min_length=2, max_length=80), AfterValidator(_printable), _NO_CONTROLS]
"""Part of a name, or an id."""
Seed = Annotated[int, Field(ge=0, le=1_000_000)]
PartName = Annotated[str, Field(min_length=1, max_length=60), AfterValidator(_printable), _NO_CONTROLS]
"""A bucket or a category."""
Reason = Annotated[str, Field(min_length=1, max_length=500), AfterValidator(_printable), _NO_CONTROLS]


class RequestModel(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)


class ResponseModel(BaseModel):
    model_config = ConfigDict(frozen=True, use_attribute_docstrings=True)
