"""The format of `results.json`: DS, RC and SR in percent, IP in [0, 1], all with 6 decimals."""

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, create_model

from mdrive_sumo.contract import TrackName
from mdrive_sumo.core.checksum import SHORT_CHECKSUM
from mdrive_sumo.core.setting import Scalar
from mdrive_sumo.core.state import End
from mdrive_sumo.core.statistics import Label
from mdrive_sumo.episode.episode_options import CONDITIONS
from mdrive_sumo.scenario.season import find_stored_season, read_stored_name

FORMAT = "mdrive-sumo/results/4"
EpisodeKey = tuple[str, int]
"""What an episode of a run is found by: the id of its scenario and its seed."""


def _six_decimals(value: float) -> float:
    return round(value, 6) + 0.0  # + 0.0: no -0.0


Number = Annotated[float, AfterValidator(_six_decimals)]


def _no_scalars() -> dict[str, float | None]:
    return {}


def _is_empty(scalars: dict[str, float | None]) -> bool:
    return not scalars


Scalars = Annotated[dict[str, Number | None], Field(exclude_if=_is_empty)]
"""Values of the scalar metrics other than `min_ttc`, null where undefined; absent if there are none."""


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
    impact_speed: Number | None = Field(default=None, exclude_if=lambda speed: speed is None)
    """Of a collision: relative speed [m/s] in the tick before the contact. Absent for everything else."""


class Speeding(_Part):
    """How long and by how much a CAV was faster than the speed limit (docs/scoring.md, Speeding)."""

    share: Number
    """Share [%] of its time in which it was more than 10 % faster."""
    greatest: Number
    """Greatest difference from the limit [m/s]; 0 if it was never faster."""


class EgoResult(_Part):
    """One CAV: DS = RC * IP."""

    id: str
    outcome: End
    reason: str
    """Why the agent failed; "" for other outcomes."""
    ds: Number
    rc: Number
    ip: Number
    ticks: int | None = None
    """Ticks from the start to its end."""
    time_ratio: Number | None = None
    """Its ticks divided by those of `omniscient`; null unless both arrived."""
    time_factor: Number | None = Field(default=None, exclude_if=lambda factor: factor is None)
    """What score mode `hard` multiplies its DS by; absent in other modes."""
    infractions: tuple[Infraction, ...]
    speeding: Speeding | None = Field(default=None, exclude_if=lambda speeding: speeding is None)
    """Absent in results from before it was measured."""
    is_other: bool = Field(default=False, exclude_if=lambda is_other: not is_other)
    """Whether the second agent of a run with two (`--others`) drove it; absent where the agent under test did."""


class SentRate(_Part):
    """What all stations together send of one type of message, a message to many counting once."""

    messages_s: Number
    """Messages in a second of the episode."""
    bytes_s: Number
    """Payload bytes in a second of the episode, without headers."""


class BusyRatioSummary(_Part):
    """Share of the time that the channel was busy at the CAVs, which each measures every 200 ms."""

    mean: Number
    """Of all measurements of all CAVs."""
    greatest: Number


class Means(_Part):
    """Driving score [%], success rates [%], route completion [%], infraction penalty [0, 1], time ratio."""

    ds: Number
    sr: Number
    rc: Number
    ip: Number
    efficient_sr: Number | None = None
    """Success rate [%] that counts successes within 2 x `omniscient`'s time; null without reference times."""
    time_ratio: Number | None = None
    """Time needed divided by `omniscient`'s time; null unless every CAV arrived, in means over where it is defined."""


class ScenarioResult(Means):
    """One run of one scenario, aggregated over its CAVs as the run's score mode says."""

    id: str
    bucket: str
    category: str
    place: str = Field(default="", exclude_if=lambda place: not place)
    """Name of its network: scenarios of one place resemble each other. Absent in results from before it was kept."""
    seed: int
    status: Literal["ok", "void"]
    """void: the benchmark or SUMO failed, not the agent. Counts as DS 0."""
    reason: str
    """Why it is void, else ""."""
    min_ttc: Number | None
    """Least time to contact [s]; null if never within 1.8 s, or void."""
    scalars: Scalars = Field(default_factory=_no_scalars)
    digest: str
    ticks: int
    egos: tuple[EgoResult, ...]
    comm: dict[str, int] = Field(default_factory=lambda: {})
    """Messages and payload bytes sent, and per fate how many deliveries; empty if nothing was said."""
    exchanged: dict[str, int] = Field(default_factory=lambda: {})
    """Messages of CAVs that reached another CAV, by type, beyond 32 types as (other). The labels of the run follow
    from them."""
    sent_rates: dict[str, SentRate] = Field(default_factory=lambda: {}, exclude_if=lambda rates: not rates)
    """What was sent in a second, by type, beyond 32 types as (other). Absent where stations send at fixed intervals
    (`v2x_rate` fixed), as in all results from before there were other ones."""
    busy_ratio: BusyRatioSummary | None = Field(default=None, exclude_if=lambda ratios: ratios is None)
    """Load of the channel; absent unless it is a radio (`its-g5`, `lte-v2x`) over which something was sent."""
    malformed: dict[str, int] = Field(default_factory=lambda: {}, exclude_if=_is_empty)
    """Messages that the channel dropped because their bytes are not valid for their type, by type and what is wrong;
    absent if there are none."""
    sensing_track: TrackName = Field(default="", exclude_if=lambda track: not track)
    """Whether any CAV was given objects; absent in void scenarios."""
    notes: dict[str, int] = Field(default_factory=lambda: {})
    """How many notes of each kind but reasons the agents left, e.g. fallbacks of a language model: every drive has
    reasons. (dropped): notes of any kind beyond the limits of an episode (32 kinds, 20 000 notes, 8 Mi characters;
    reasons have half of that)."""

    @property
    def key(self) -> EpisodeKey:
        """The scenario and the seed."""
        return self.id, self.seed

    @property
    def label(self) -> Label:
        """Place, scenario and seed, by which means are resampled; without a known place the scenario is one."""
        return self.place or self.id, self.id, self.seed

    def find_scalar(self, name: str) -> float | None:
        """Return the value of a scalar metric; None where it is undefined or was not computed."""
        return self.min_ttc if name == "min_ttc" else self.scalars.get(name)


class BucketResult(Means):
    """Mean over the episodes of a bucket's scenarios, each with the same weight."""

    scenarios: int
    """Different scenarios; with several seeds each has as many episodes."""
    timed: int = 0
    """Over how many episodes `time_ratio` is a mean: those in which every CAV arrived."""
    scalars: Scalars = Field(default_factory=_no_scalars)
    """Means of the scalar metrics over the episodes in which each is defined."""


class RoleMeans(_Part):
    """What the CAVs of one agent reached in a run of two agents: means over scenarios of means over these CAVs."""

    cavs: int
    """CAVs in all episodes."""
    ds: Number
    sr: Number
    rc: Number
    ip: Number
    time_ratio: Number | None = None
    """Mean over the CAVs that have one."""


class Roles(_Part):
    """A run of two agents (`--others`), agent by agent. Scores are those of single CAVs, whatever the score mode."""

    tested: RoleMeans
    """CAVs of the agent under test."""
    others: RoleMeans | None
    """CAVs of the second agent; null if it drove none."""


class Overall(_Part):
    """The paper's numbers are means of bucket values, its caption says mean over scenarios: both are here."""

    bucket_mean: Means
    scenario_mean: Means
    timed: int = 0
    """Episodes in which every CAV arrived; the time ratios are means over these."""
    scalars: Scalars = Field(default_factory=_no_scalars)
    """Means of the scalar metrics over the episodes in which each is defined."""
    roles: Roles | None = Field(default=None, exclude_if=lambda roles: roles is None)
    """Scores by agent in a run of two agents; absent in a run of one."""


class _RunFacts(_Part):
    """What was run, with what; `RunInfo` without the conditions of the episodes."""

    agent: str
    labels: tuple[str, ...] = ()
    """What the agent did and declared: single, sharing or negotiation by the messages that its CAVs exchanged; joint,
    privileged; unsandboxed for a third-party agent without a box."""
    sensing_track: TrackName = Field(default="", exclude_if=lambda track: not track)
    """sensor: CAVs had only what a car carries; object: some had lists of objects. Follows from the scenarios; absent
    if all scenarios are void."""
    declared_label: str = ""
    """What the agent says of itself; nothing depends on it."""
    agent_config: str = ""
    """Hash of the agent's configuration, the files that it names included."""
    others: str = Field(default="", exclude_if=lambda others: not others)
    """The agent of the CAVs that are not under test (`--others`); absent in a run of one agent."""
    penetration: int | None = Field(default=None, exclude_if=lambda penetration: penetration is None)
    """Percentage of the CAVs under test; absent if it is one CAV, or all."""
    suite: str
    """Name of the suite, with its season unless that is season 0: `mdrive@1`, `mdrive`."""
    suite_checksum: str
    seed: int
    """The first seed."""
    seeds: tuple[int, ...] = Field(default=(), exclude_if=lambda seeds: not seeds)
    """All seeds of a run of several; absent in a run of one."""
    score_mode: str
    versions: dict[str, str]
    plug_ins: dict[str, str] = Field(default_factory=lambda: {}, exclude_if=_is_empty)
    """Metrics, agents and scenario sources of other packages that the run depends on: package, version and checksum by
    "KIND NAME"; absent without any."""
    command: tuple[str, ...] = ()
    comm: dict[str, str | float | bool] = Field(default_factory=lambda: {})
    """Settings of the V2X channel."""
    agent_clock: str = "ideal"
    """What thinking costs: ideal, fixed:MS, or measured (which no other machine reproduces)."""

    @property
    def conditions(self) -> dict[str, Scalar]:
        """The conditions of the episodes besides channel and clock, by name: those of `EpisodeOptions`.

        What a file from before a condition does not say is "unknown".
        """
        values = {condition.label: getattr(self, condition.key) for condition in CONDITIONS}
        return {label: "unknown" if value == "" else value for label, value in values.items()}

    @property
    def shown_conditions(self) -> dict[str, Scalar]:
        """The conditions without those that reports leave out because they have their default."""
        hidden = {one.label for one in CONDITIONS if one.is_hidden(getattr(self, one.key))}
        return {label: value for label, value in self.conditions.items() if label not in hidden}

    @property
    def suite_label(self) -> str:
        """Name of the suite with any season, as people read it: `mdrive@0`."""
        return read_stored_name(self.suite)

    @property
    def season(self) -> str:
        """The season of the suite: "0" if it names none; "" if it has no seasons."""
        return find_stored_season(self.suite)

    def describe_suite(self) -> str:
        """Return the suite with its season and the beginning of its checksum: `mdrive@0 (344da55d63ee)`."""
        return f"{self.suite_label} ({self.suite_checksum.removeprefix('sha256:')[:SHORT_CHECKSUM]})"

    @property
    def all_seeds(self) -> tuple[int, ...]:
        """The seeds of the run, in the order of its episodes."""
        return self.seeds or (self.seed,)

    def find_key(self, result: ScenarioResult) -> EpisodeKey:
        """Return what a result of this run is found by; in a run of one seed only the scenario counts."""
        return result.key if len(self.all_seeds) > 1 else (result.id, self.seed)


if TYPE_CHECKING:
    RunInfo = _RunFacts
else:
    RunInfo = create_model(
        "RunInfo",
        __base__=_RunFacts,
        __doc__="What was run, with what.",
        __module__=__name__,
        **{
            one.key: (
                one.stored_kind,
                Field(
                    default=one.write(one.default) if one.absent is None else one.absent,
                    exclude_if=one.is_hidden if one.hides_default else None,
                ),
            )
            for one in CONDITIONS
        },
    )
    # One field for each condition: a new one needs no line here. Results from before it have its default, unless
    # that is not how episodes then were: `Setting.absent`.


class Results(_Part):
    """The whole file."""

    format: Literal["mdrive-sumo/results/4"] = FORMAT
    run: RunInfo
    overall: Overall
    buckets: dict[str, BucketResult]
    void: int
    """How many episodes are void."""
    planned: int | None = Field(default=None, exclude_if=lambda planned: planned is None)
    """How many episodes the run has, if these are the results of a part of them; absent in a finished run."""
    scenarios: tuple[ScenarioResult, ...]
    """One entry for every scenario, in a run of several seeds for every scenario and seed."""
