"""Infractions of logged drives that a person has looked at and confirmed: the driver of the log did that."""

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.scenario.scenario import describe_first_error

SAME_TIME_S = 0.5
"""[s] A confirmation holds for an infraction at most this far from its time: smoothing may shift it by some frames."""
FACTOR_SLACK = 0.005
"""A confirmation does not hold for a penalty factor that is lower by more than this: that is a worse infraction."""
MAX_BYTES = 1_000_000
"""Chosen: room for thousands of entries, which a person writes by hand."""

Text = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=500)]


class ConfirmedInfraction(BaseModel):
    """One entry of the file: an infraction as quality.json lists it, why it is the driver's own, and the person."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    scenario: Text
    cav: Text
    """Id of the CAV in the scenario."""
    kind: Text
    time_s: float = Field(ge=0, allow_inf_nan=False)
    factor: float = Field(ge=0, le=1)
    """Penalty factor of the infraction."""
    reason: Text
    """What the person saw on the picture."""
    by: Text
    """Name of the person who has looked at the picture."""

    def covers(self, kind: str, time_s: float, factor: float) -> bool:
        """Return whether an infraction of this scenario and CAV is the confirmed one, and no worse."""
        is_same = kind == self.kind and abs(time_s - self.time_s) <= SAME_TIME_S
        return is_same and factor >= self.factor - FACTOR_SLACK


class _ConfirmedFile(BaseModel):
    model_config = ConfigDict(extra="forbid")

    confirmed: tuple[ConfirmedInfraction, ...]


def load_confirmed_infractions(path: Path) -> tuple[ConfirmedInfraction, ...]:
    """Read a TOML file of `[[confirmed]]` tables; raise InputError."""
    try:
        content = read_bytes(path, MAX_BYTES)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    try:
        tables = tomllib.loads(content.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: expected TOML with [[confirmed]] tables, found: {error}") from None
    try:
        return _ConfirmedFile.model_validate(tables).confirmed
    except ValidationError as error:
        raise InputError(f"{path}: {describe_first_error(error)}") from None


def describe_unused(confirmed: Sequence[ConfirmedInfraction]) -> tuple[str, ...]:
    """Return a note for each confirmation that no infraction matches."""
    return tuple(
        f"confirmed infraction not found: {entry.kind} of CAV {entry.cav} at {entry.time_s:g} s with factor"
        f" {entry.factor:g} or higher (confirmed by {entry.by}): remove the entry or look again"
        for entry in confirmed
    )
