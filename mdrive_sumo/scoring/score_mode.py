"""Score modes: how the CAVs of one scenario are aggregated (protocol 8.2)."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import StrEnum
from types import MappingProxyType
from typing import Protocol

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.suggestion import describe_unknown
from mdrive_sumo.scoring.results import Means

SUCCESS_DS = 99.95
"""A CAV, or in the InterDrive modes a scenario, succeeds above this driving score."""
FORGIVEN = ("red-light", "stop-sign")
"""Infractions whose factors the InterDrive modes divide out."""


class ScoreMode(StrEnum):
    """`mdrive` is the mode of the paper, `hard` that in which the time counts; the others are InterDrive's."""

    MDRIVE = "mdrive"
    HARD = "hard"
    INTERDRIVE_FIXED = "interdrive_fixed"
    INTERDRIVE_ASIS = "interdrive_asis"


class PricedInfraction(Protocol):
    """What a score mode reads of an infraction."""

    @property
    def kind(self) -> str:
        """Its kind, e.g. `red-light`."""
        ...

    @property
    def factor(self) -> float:
        """The factor that it multiplies IP by."""
        ...


class ScoredEgo(Protocol):
    """What a score mode reads of a CAV: of a recorded one (`EgoRecord`), or of one in a results file."""

    @property
    def rc(self) -> float:
        """Route completion [%]."""
        ...

    @property
    def ip(self) -> float:
        """Infraction penalty in [0, 1]."""
        ...

    @property
    def infractions(self) -> Sequence[PricedInfraction]:
        """Its infractions."""
        ...

    @property
    def time_factor(self) -> float | None:
        """Factor of mode `hard` in [0, 1], see `efficiency.compute_time_factor`; None before it is known."""
        ...


def compute_driving_score(record: ScoredEgo) -> float:
    """Return DS [%] of one CAV: max(RC * IP, 0)."""
    return max(record.rc * record.ip, 0.0)


def compute_scenario_means(records: Sequence[ScoredEgo], mode: ScoreMode) -> Means:
    """Return DS, SR, RC and IP of one scenario."""
    return _AGGREGATE_BY_MODE[mode](records)


def compute_mean(values: Iterable[float]) -> float:
    """Return the mean, independent of the order of the values."""
    listed = tuple(values)
    return math.fsum(listed) / len(listed)


def _aggregate_mdrive(records: Sequence[ScoredEgo]) -> Means:
    """Return means over the CAVs; SR is the share of CAVs that succeed."""
    scores = [compute_driving_score(record) for record in records]
    return Means(
        ds=compute_mean(scores),
        sr=100.0 * compute_mean(score > SUCCESS_DS for score in scores),
        rc=compute_mean(record.rc for record in records),
        ip=compute_mean(record.ip for record in records),
    )


def _aggregate_hard(records: Sequence[ScoredEgo]) -> Means:
    """Return means over the CAVs as in `mdrive`, but DS is multiplied by each CAV's time factor."""
    timed = [
        compute_driving_score(record) * (1.0 if record.time_factor is None else record.time_factor)
        for record in records
    ]
    return _aggregate_mdrive(records).model_copy(update={"ds": compute_mean(timed)})


def _aggregate_interdrive_fixed(records: Sequence[ScoredEgo]) -> Means:
    """Return mean RC times the product of all IP, with all red-light and stop-sign factors divided out."""
    return _aggregate_interdrive(records, penalised=records, forgiven=records)


def _aggregate_interdrive_asis(records: Sequence[ScoredEgo]) -> Means:
    """Return the published score with its bug (K1): ego 0's IP counts as 1 and is still divided: DS can be 125."""
    return _aggregate_interdrive(records, penalised=records[1:], forgiven=records[:1])


def _aggregate_interdrive(
    records: Sequence[ScoredEgo], penalised: Sequence[ScoredEgo], forgiven: Sequence[ScoredEgo]
) -> Means:
    """Return the InterDrive score. `ip` is the product before division, so `ds` may differ from rc * ip."""
    rc, ip = compute_mean(record.rc for record in records), math.prod(record.ip for record in penalised)
    factors = [i.factor for record in forgiven for i in record.infractions if i.kind in FORGIVEN]
    ds = max(rc * ip / math.prod(factors), 0.0)
    return Means(ds=ds, sr=100.0 * (ds > SUCCESS_DS), rc=rc, ip=ip)


_AGGREGATE_BY_MODE: Mapping[ScoreMode, Callable[[Sequence[ScoredEgo]], Means]] = MappingProxyType(
    {
        ScoreMode.MDRIVE: _aggregate_mdrive,
        ScoreMode.HARD: _aggregate_hard,
        ScoreMode.INTERDRIVE_FIXED: _aggregate_interdrive_fixed,
        ScoreMode.INTERDRIVE_ASIS: _aggregate_interdrive_asis,
    }
)


def parse_score_mode(text: str) -> ScoreMode:
    """Return a score mode by its name. Raises InputError."""
    names = [mode.value for mode in ScoreMode]
    if text not in names:
        raise InputError(f"score mode: {describe_unknown(text, names)}")
    return ScoreMode(text)
