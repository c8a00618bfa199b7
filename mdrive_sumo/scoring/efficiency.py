"""Time ratio and efficient success rate: an agent's time against the time of `omniscient` (docs/scoring.md)."""

from collections.abc import Iterable, Mapping, Sequence

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import End
from mdrive_sumo.scenario.reference_times import REFERENCE_TIMES_FILE, ReferenceTicks
from mdrive_sumo.scoring.results import EgoResult, ScenarioResult
from mdrive_sumo.scoring.score_mode import SUCCESS_DS, ScoreMode, compute_mean

EFFICIENT_RATIO = 2.0
"""A success is efficient up to this time ratio. Issue G: success within 2 x `omniscient`'s time."""


NO_LIMITS: Mapping[str, int] = {}


def apply_reference_times(
    result: ScenarioResult, reference: ReferenceTicks, mode: ScoreMode, limits: Mapping[str, int] = NO_LIMITS
) -> ScenarioResult:
    """Return a scenario's result with the time ratio of each CAV and of the scenario, and efficient SR, set anew.

    reference: ticks of `omniscient` by CAV; empty: there is none, then all of them are undefined. limits: time limit
    [ticks] by CAV, which mode `hard` needs: it also sets time factors and DS, and raises InputError without reference.
    """
    egos = tuple(
        ego.model_copy(update={"time_ratio": _compute_ego_ratio(ego, reference.get(ego.id))}) for ego in result.egos
    )
    hard: dict[str, float] = {}
    if mode is ScoreMode.HARD:
        check_reference(result.id, reference)
        factors = [round(compute_time_factor(ego, reference[ego.id], limits[ego.id]), 6) for ego in egos]
        pairs = list(zip(egos, factors, strict=True))
        egos = tuple(ego.model_copy(update={"time_factor": factor}) for ego, factor in pairs)
        hard = {"ds": round(compute_mean(ego.ds * factor for ego, factor in pairs), 6) if pairs else 0.0}
    ratios = [ego.time_ratio for ego in egos if ego.time_ratio is not None]
    return result.model_copy(
        update={
            **hard,
            "egos": egos,
            "time_ratio": round(compute_mean(ratios), 6) if ratios and len(ratios) == len(egos) else None,
            "efficient_sr": round(compute_efficient_sr(result.sr, egos, mode), 6) if reference else None,
        }
    )


def compute_time_factor(ego: EgoResult, reference: int, limit: int) -> float:
    """Return what mode `hard` multiplies the DS of a CAV by: min(1, time of `omniscient` / own time), both in ticks.

    Own time is that of the arrival of a CAV that completed its route without a penalised infraction. Of every other CAV
    it is the time limit, the longest that any may take: no haste makes up for an infraction or a route not completed.
    """
    is_clean = ego.outcome is End.ARRIVED and ego.ip >= 1.0 and bool(ego.ticks)
    return min(1.0, reference / max(ego.ticks if is_clean and ego.ticks else limit, 1))


def check_reference(scenario: str, reference: ReferenceTicks, found: str = "none") -> None:
    """Raise InputError if a scenario has no reference times: mode `hard` cannot score it.

    found: what the file has instead (`describe_stored_times`).
    """
    if not reference:
        raise InputError(
            f"scenario {scenario}: score mode hard: expected times of omniscient for every CAV in"
            f" {REFERENCE_TIMES_FILE}, found {found}; `mdrive-sumo validate SUITE --write` measures them, --score-mode"
            " mdrive needs none"
        )


def find_arrival_ticks(egos: Iterable[EgoResult]) -> dict[str, int]:
    """Return the ticks from the start to the arrival of the CAVs that arrived, by id: `omniscient`'s are a reference.

    A CAV that starts at its goal has no time to compare with and is left out.
    """
    return {ego.id: ego.ticks for ego in egos if ego.outcome is End.ARRIVED and ego.ticks}


def _compute_ego_ratio(ego: EgoResult, reference: int | None) -> float | None:
    if ego.outcome != End.ARRIVED or ego.ticks is None or reference is None:
        return None
    return round(ego.ticks / reference, 6)


def compute_efficient_sr(sr: float, egos: Sequence[EgoResult], mode: ScoreMode) -> float:
    """Return efficient SR [%] by the mode's own notion of success: of each CAV, or of the whole scenario."""
    in_time = [ego.time_ratio is not None and ego.time_ratio <= EFFICIENT_RATIO for ego in egos]
    if not in_time:
        return 0.0  # void
    if mode not in (ScoreMode.MDRIVE, ScoreMode.HARD):
        return sr if all(in_time) else 0.0
    return 100.0 * compute_mean(early and ego.ds > SUCCESS_DS for early, ego in zip(in_time, egos, strict=True))
