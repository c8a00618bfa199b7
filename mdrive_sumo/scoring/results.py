"""The format of `results.json`: DS, RC and SR in percent, IP in [0, 1], all with 6 decimals."""

from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from mdrive_sumo.core.state import End

FORMAT = "mdrive-sumo/results/2"


def _six_decimals(value: float) -> float:
    return round(value, 6) + 0.0  # + 0.0: no -0.0


Number = Annotated[float, AfterValidator(_six_decimals)]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Infraction(_Part):
    """One event: its place [m] is the CAV's box centre; `factor` multiplies IP, 1 marks without a cost."""

    kind: str
    tick: int
    x: Number
    y: Number
    factor: Number
    other: str
    """Id of what it concerns, "" where there is none."""


class EgoResult(_Part):
    """One CAV: DS = RC * IP."""

    id: str
    outcome: End
    reason: str
    """Why the agent failed; "" for other outcomes."""
    ds: Number
    rc: Number
    ip: Number
    infractions: tuple[Infraction, ...]


class Means(_Part):
    """Driving score [%], success rate [%], route completion [%], infraction penalty [0, 1]."""

    ds: Number
    sr: Number
    rc: Number
    ip: Number


class ScenarioResult(Means):
    """One run of one scenario, aggregated over its CAVs as the run's score mode says."""

    id: str
    bucket: str
    category: str
    seed: int
    status: Literal["ok", "void"]
    """void: the benchmark or SUMO failed, not the agent. Counts as DS 0."""
    reason: str
    """Why it is void, else ""."""
    min_ttc: Number | None
    """Least time to contact [s]; null if never within 1.8 s, or void."""
    scalars: dict[str, Number | None] = Field(default_factory=lambda: {}, exclude_if=lambda scalars: not scalars)
    """Values of the scalar metrics other than `min_ttc`; absent if there are none."""
    digest: str
    ticks: int
    egos: tuple[EgoResult, ...]
    comm: dict[str, int] = Field(default_factory=lambda: {})
    """Messages and payload bytes sent, and per fate how many deliveries; empty if nothing was said."""
    notes: dict[str, int] = Field(default_factory=lambda: {})
    """How many notes of each kind the agents left, e.g. fallbacks of a language model."""

    def find_scalar(self, name: str) -> float | None:
        """Return the value of a scalar metric; None where it is undefined or was not computed."""
        return self.min_ttc if name == "min_ttc" else self.scalars.get(name)


class BucketResult(Means):
    """Mean over the runs of a bucket's scenarios, each with the same weight."""

    scenarios: int


class Overall(_Part):
    """The paper's numbers are means of bucket values, its caption says mean over scenarios: both are here."""

    bucket_mean: Means
    scenario_mean: Means


class RunInfo(_Part):
    """What was run, with what."""

    agent: str
    labels: tuple[str, ...] = ()
    """What the agent is: single, sharing, negotiation, joint, privileged."""
    agent_config: str = ""
    """Hash of the agent's configuration."""
    suite: str
    suite_checksum: str
    seed: int
    score_mode: str
    versions: dict[str, str]
    command: tuple[str, ...] = ()
    comm: dict[str, str | float | bool] = Field(default_factory=lambda: {})
    """Settings of the V2X channel."""
    agent_clock: str = "ideal"
    """What thinking costs: ideal, fixed:MS, or measured (which no other machine reproduces)."""
    actors: str = "default"
    """How scripted road users behave: default (reactive, on a global clock), or original as in MDrive's code."""
    friction: str = "dry"
    """How slippery roads are: dry in every weather, or as the scenario's weather makes them."""
    sensing: str = ""
    """How well own states and objects are sensed: realistic or perfect; "" in files from before this option."""


class Results(_Part):
    """The whole file."""

    format: Literal["mdrive-sumo/results/2"] = FORMAT
    run: RunInfo
    overall: Overall
    buckets: dict[str, BucketResult]
    void: int
    """How many scenarios are void."""
    scenarios: tuple[ScenarioResult, ...]
