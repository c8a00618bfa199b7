"""Settings of a phase: one `[[phases]]` section of the server's settings file."""

from datetime import UTC, datetime
from typing import Annotated, Self

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, model_validator

from server.store.phases import NewPhase

Count = Annotated[int, Field(ge=1)]


class SettingsModel(BaseModel):
    """Base class of all sections."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class PhaseSettings(SettingsModel):
    """One `[[phases]]` section."""

    id: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9-]{0,39}$")]
    title: Annotated[str, Field(min_length=1, max_length=120)]
    suite: Annotated[str, Field(min_length=1)]
    """A packaged suite's name or a folder on this machine."""
    public: bool
    """False: the scenarios are hidden; only aggregates are shown."""
    packaged_suite: bool = False
    """Whether a hidden phase may have scenarios of a packaged suite, which everyone can read: for trials."""
    opens: AwareDatetime
    closes: AwareDatetime
    per_day: Count = 10
    in_parallel: Count = 1
    in_total: Count = 1000
    seeds: Count = 1
    sensor_track_only: bool = False
    """Whether agents that are given lists of objects (docs/sensors.md, sensor track) are rejected."""
    cross_play_scenarios: Annotated[int, Field(ge=0, le=50)] = 0
    """Scenarios that each pair of ranked agents drives together for the board of cross-play; 0: no such board."""

    @model_validator(mode="after")
    def _has_a_length(self) -> Self:
        if self.closes <= self.opens:
            raise ValueError(f"closes: expected a time after opens {self.opens}, found {self.closes}")
        return self

    def as_new(self) -> NewPhase:
        """Return the phase for the store."""
        copied = self.model_dump(exclude={"opens", "closes", "packaged_suite"})
        return NewPhase(opens_us=_to_us(self.opens), closes_us=_to_us(self.closes), **copied)


WARM_UP = PhaseSettings(
    id="warm-up",
    title="Warm-up",
    suite="interdrive",
    public=True,
    opens=datetime(2026, 1, 1, tzinfo=UTC),
    closes=datetime(2100, 1, 1, tzinfo=UTC),
    per_day=100,
)
"""Default phase of `mdrive-sumo serve` without settings."""


def _to_us(moment: datetime) -> int:
    return int(moment.timestamp()) * 1_000_000
