"""Compare two submissions of a phase: what the caller may see of each, and the scenarios that both have."""

from collections.abc import Sequence
from statistics import fmean

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.statistics import bootstrap_nested
from server.api import submission_views
from server.api.dependencies import Services
from server.api.routes import results
from server.api.schemas.scenarios import ComparisonOut, PairedDifferenceOut, ScenarioOut, ScenarioPairOut
from server.api.submission_views import Caller
from server.store import standings

TIE = 0.005
"""Driving scores closer than this are equal, as in `mdrive-sumo compare` [%]."""


def compare_submissions(a: str, b: str, caller: Caller | None, services: Services) -> ComparisonOut:
    """Return B against A. Raises NotFound unless the caller may see both, InputError unless their phase is the same."""
    with services.store.read() as session:
        first, second = (submission_views.find_visible(session, caller, each) for each in (a, b))
        if a == b:
            raise InputError("compare: expected two submissions, found the same twice")
        if first.phase != second.phase:
            raise InputError(f"compare: expected submissions of one phase, found {first.phase} and {second.phase}")
        may_see = submission_views.may_see_scenarios(caller, submission_views.get_phase(session, first))
        shown = [submission_views.to_submission(session, caller, each) for each in (first, second)]
        digests = {standings.evaluator_digest(each.evaluator) for each in (first, second)}
    pairs = None
    if may_see:
        of_a, of_b = (results.list_scenarios(each, caller, services).items for each in (a, b))
        pairs = _pair_scenarios(of_a, of_b)
    return ComparisonOut(
        a=shown[0],
        b=shown[1],
        same_evaluator=len(digests) == 1,
        paired=_compute_difference(pairs) if pairs else None,
        scenarios=pairs,
    )


def _pair_scenarios(of_a: Sequence[ScenarioOut], of_b: Sequence[ScenarioOut]) -> list[ScenarioPairOut]:
    others = {(row.scenario, row.seed): row for row in of_b}
    pairs = [
        ScenarioPairOut(
            scenario=row.scenario,
            seed=row.seed,
            bucket=row.bucket,
            category=row.category,
            place=row.place or other.place,
            verdict_a=row.verdict,
            verdict_b=other.verdict,
            ds_a=row.ds,
            ds_b=other.ds,
            ds_difference=other.ds - row.ds,
        )
        for row in of_a
        if (other := others.get((row.scenario, row.seed))) is not None and row.ds is not None and other.ds is not None
    ]
    return sorted(pairs, key=lambda pair: (pair.ds_difference, pair.scenario, pair.seed))


def _compute_difference(pairs: Sequence[ScenarioPairOut]) -> PairedDifferenceOut:
    by_scenario: dict[str, list[float]] = {}
    for pair in pairs:
        by_scenario.setdefault(pair.scenario, []).append(pair.ds_difference)
    means = [fmean(differences) for differences in by_scenario.values()]
    labels = [(pair.place or pair.scenario, pair.scenario, pair.seed) for pair in pairs]
    interval = bootstrap_nested([pair.ds_difference for pair in pairs], labels)
    better, worse = sum(mean >= TIE for mean in means), sum(mean <= -TIE for mean in means)
    return PairedDifferenceOut(
        scenarios=len(means),
        ds=interval.mean,
        ds_low=interval.low,
        ds_high=interval.high,
        better=better,
        equal=len(means) - better - worse,
        worse=worse,
    )
