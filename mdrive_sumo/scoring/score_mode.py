"""Score modes: how the CAVs of one scenario make one score (protocol 8.2)."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import StrEnum
from types import MappingProxyType

from mdrive_sumo.scoring.metrics import EgoRecord
from mdrive_sumo.scoring.results import Means

SUCCESS_DS = 99.95
"""A CAV, or in the InterDrive modes a scenario, succeeds above this driving score."""
FORGIVEN = ("red-light", "stop-sign")
"""Infractions that the InterDrive modes divide out."""


class ScoreMode(StrEnum):
    """mdrive is what the paper uses; the others serve parity studies with InterDrive's own aggregator."""

    MDRIVE = "mdrive"
    INTERDRIVE_FIXED = "interdrive_fixed"
    INTERDRIVE_ASIS = "interdrive_asis"


def compute_driving_score(record: EgoRecord) -> float:
    """DS [%] of one CAV: max(RC * IP, 0)."""
    return max(record.rc * record.ip, 0.0)


def compute_scenario_means(records: Sequence[EgoRecord], mode: ScoreMode) -> Means:
    """DS, SR, RC and IP of one scenario."""
    return _MODES[mode](records)


def compute_mean(values: Iterable[float]) -> float:
    """Mean, the same for every order of the values."""
    listed = tuple(values)
    return math.fsum(listed) / len(listed)


def _mdrive(records: Sequence[EgoRecord]) -> Means:
    """Plain means over the CAVs; SR is the share of CAVs that succeed."""
    scores = [compute_driving_score(record) for record in records]
    return Means(
        ds=compute_mean(scores),
        sr=100.0 * compute_mean(score > SUCCESS_DS for score in scores),
        rc=compute_mean(record.rc for record in records),
        ip=compute_mean(record.ip for record in records),
    )


def _interdrive_fixed(records: Sequence[EgoRecord]) -> Means:
    """Mean RC times the product of all IP, with every red-light and stop-sign factor divided out."""
    return _interdrive(records, penalised=records, forgiven=records)


def _interdrive_asis(records: Sequence[EgoRecord]) -> Means:
    """As published, bug included (K1): ego 0's IP counts as 1 and is yet divided: DS can be 125."""
    return _interdrive(records, penalised=records[1:], forgiven=records[:1])


def _interdrive(records: Sequence[EgoRecord], penalised: Sequence[EgoRecord], forgiven: Sequence[EgoRecord]) -> Means:
    """`ip` is the product before anything is divided out, so `ds` is not rc * ip where something is."""
    rc, ip = compute_mean(record.rc for record in records), math.prod(record.ip for record in penalised)
    factors = [i.factor for record in forgiven for i in record.infractions if i.kind in FORGIVEN]
    ds = max(rc * ip / math.prod(factors), 0.0)
    return Means(ds=ds, sr=100.0 * (ds > SUCCESS_DS), rc=rc, ip=ip)


_MODES: Mapping[ScoreMode, Callable[[Sequence[EgoRecord]], Means]] = MappingProxyType(
    {
        ScoreMode.MDRIVE: _mdrive,
        ScoreMode.INTERDRIVE_FIXED: _interdrive_fixed,
        ScoreMode.INTERDRIVE_ASIS: _interdrive_asis,
    }
)
