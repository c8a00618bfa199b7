"""Find what a results file cannot say: impossible values, entries twice, means that do not fit what they are means of.

Every figure but those of single infractions follows from others in the file, so a figure changed alone is found without
driving. Values that were all changed so that they fit each other are found by `verify` only.
"""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from mdrive_sumo.contract import join_sensing_tracks
from mdrive_sumo.core.clean_text import clean_line, truncate
from mdrive_sumo.core.state import End
from mdrive_sumo.core.tree_difference import find_tree_differences, format_leaf
from mdrive_sumo.scoring.efficiency import compute_efficient_sr
from mdrive_sumo.scoring.results import EgoResult, Infraction, Means, Results, ScenarioResult, Speeding
from mdrive_sumo.scoring.score_mode import SUCCESS_DS, ScoreMode, compute_mean, compute_scenario_means
from mdrive_sumo.scoring.summary import compute_bucket_means, compute_overall

SUM_TOLERANCE = 2e-6
"""Largest difference of a mean recomputed from values of 6 decimals."""
SCORE_TOLERANCE = 1e-4
"""The same for a driving score: RC [%] times a product of factors, each rounded to 6 decimals."""
LARGEST = 1e9
"""Greatest value where there is no smaller bound: metres, ticks, ratios. Sums of larger numbers could overflow."""
PERCENT, FACTOR, POSITIVE, PLACE = (0.0, 100.0), (0.0, 1.0), (0.0, LARGEST), (-LARGEST, LARGEST)
"""Least and greatest value of each kind of figure."""
MAX_NAME = 1000
"""Characters of an id, or of an agent's path."""
MAX_SEED = 2**63
RANGES = {
    **dict.fromkeys(("ds", "sr", "rc", "efficient_sr"), PERCENT),
    "ip": FACTOR,
    "time_factor": FACTOR,
    "share": PERCENT,
    "greatest": POSITIVE,
    "factor": FACTOR,
    **dict.fromkeys(("time_ratio", "min_ttc", "ticks", "tick", "impact_speed"), POSITIVE),
    **dict.fromkeys(("x", "y"), PLACE),
}


@dataclass(frozen=True, slots=True)
class _EgoFactors:
    """What the driving score of a CAV is computed from; IP from the factors, because `ip` is rounded."""

    rc: float
    infractions: tuple[Infraction, ...]
    time_factor: float | None = None

    @property
    def ip(self) -> float:
        return math.prod(infraction.factor for infraction in self.infractions)


def find_result_faults(results: Results) -> Iterator[str]:
    """Yield a sentence (place, expected, found) about everything in a results file that cannot be."""
    modes = [mode.value for mode in ScoreMode]
    if results.run.score_mode not in modes:
        yield f"run.score_mode: expected one of {', '.join(modes)}, found {format_leaf(results.run.score_mode)}"
        return
    if not results.scenarios:
        yield "scenarios: expected at least one, found none"
        return
    yield from _find_name_faults(results)
    if any(abs(seed) > MAX_SEED for seed in (*results.run.all_seeds, *(one.seed for one in results.scenarios))):
        yield f"run.seeds: expected at most {MAX_SEED}, found more"
        return
    yield from _find_seed_faults(results)
    yield from find_repeated_episodes(results.scenarios)
    mode, seeds = ScoreMode(results.run.score_mode), results.run.all_seeds
    for scenario in results.scenarios:
        yield from find_scenario_faults(scenario, mode, seeds)
    if any(True for one in results.scenarios for _ in _find_all_range_faults("", one, mode)):
        return  # their means cannot be computed
    yield from _find_summary_faults(results)
    yield from _find_track_faults(results)


def find_scenario_faults(result: ScenarioResult, mode: ScoreMode, seeds: Sequence[int]) -> Iterator[str]:
    """Yield a sentence about everything in the result of a scenario that cannot be in a run of this mode and seeds."""
    place = name_place(result, seeds)
    if result.seed not in seeds:
        yield f"{place}.seed: expected the run's {' or '.join(map(str, seeds))}, found {result.seed}"
    if impossible := [*_find_all_range_faults(place, result, mode)]:
        yield from impossible
        return  # what follows computes with these values
    yield from find_repeated((ego.id for ego in result.egos), f"{place}.egos")
    for name in ("comm", "exchanged", "notes"):
        for kind, count in getattr(result, name).items():
            if count < 0:
                yield f"{place}.{name}.{kind}: expected a number of at least 0, found {count}"
    for kind, rate in result.sent_rates.items():
        if rate.messages_s < 0 or rate.bytes_s < 0:
            yield f"{place}.sent_rates.{kind}: expected rates of at least 0, found {rate.messages_s}, {rate.bytes_s}"
    if (busy := result.busy_ratio) and not 0 <= busy.mean <= busy.greatest <= 1:
        yield f"{place}.busy_ratio: expected 0 <= mean <= greatest <= 1, found {busy.mean}, {busy.greatest}"
    for ego in result.egos:
        yield from _find_ego_faults(f"{place}.egos[{ego.id}]", ego, result.ticks)
    yield from _find_mean_faults(place, result, mode)


def _find_all_range_faults(place: str, result: ScenarioResult, mode: ScoreMode) -> Iterator[str]:
    """Yield a sentence about every value of a scenario, its CAVs and their infractions beyond its range."""
    yield from _find_range_faults(place, result, mode)
    for ego in result.egos:
        yield from _find_range_faults(f"{place}.egos[{ego.id}]", ego, ScoreMode.MDRIVE)
        if ego.speeding is not None:
            yield from _find_range_faults(f"{place}.egos[{ego.id}].speeding", ego.speeding, ScoreMode.MDRIVE)
        for i, infraction in enumerate(ego.infractions):
            yield from _find_range_faults(f"{place}.egos[{ego.id}].infractions[{i}]", infraction, ScoreMode.MDRIVE)
    for name, value in result.scalars.items():
        if value is not None and abs(value) > LARGEST:
            yield f"{place}.scalars.{name}: expected at most {LARGEST:g}, found {format_leaf(value)}"


def name_place(result: ScenarioResult, seeds: Sequence[int]) -> str:
    """Return the place of a result in a file of these seeds, as sentences name it."""
    return f"scenarios[{result.id}]" if len(seeds) == 1 else f"scenarios[{result.id}, seed {result.seed}]"


def find_repeated_episodes(results: Iterable[ScenarioResult]) -> Iterator[str]:
    """Yield a sentence about every scenario and seed that occurs more than once."""
    for (name, _), count in Counter(result.key for result in results).items():
        if count > 1:
            yield f"scenarios: expected every id once, found {name!r} {count} times"


def _find_name_faults(results: Results) -> Iterator[str]:
    """Yield a sentence about every name that is too long, or that is no line of text."""
    run = results.run
    yield from _find_text_faults({f"run.{name}": value for name, value in run if isinstance(value, str)})
    for result in results.scenarios:
        yield from _find_text_faults({"scenarios.id": result.id, "bucket": result.bucket, "category": result.category})
        for ego in result.egos:
            yield from _find_text_faults({"egos.id": ego.id})
            for infraction in ego.infractions:
                yield from _find_text_faults(
                    {"infractions.kind": infraction.kind, "infractions.other": infraction.other}
                )


def _find_text_faults(named: Mapping[str, str]) -> Iterator[str]:
    for place, name in named.items():
        if len(name) > MAX_NAME:
            yield f"{place}: expected at most {MAX_NAME} characters, found {len(name)}"
        elif clean_line(name) != name:
            yield f"{place}: expected a line of text, found {truncate(ascii(name), 80)}"


def _find_seed_faults(results: Results) -> Iterator[str]:
    """Yield a sentence if seeds are named twice, or some scenario lacks one."""
    seeds = results.run.all_seeds
    if results.run.seed != seeds[0] or len(set(seeds)) < len(seeds):
        yield f"run.seeds: expected different seeds beginning with {results.run.seed}, found {list(seeds)}"
    if len(seeds) > 1:
        driven = {result.key for result in results.scenarios}
        for name, seed in ((result.id, seed) for result in results.scenarios for seed in seeds):
            if (name, seed) not in driven:
                yield f"scenarios: expected {name!r} with seed {seed}, found none"
                return


def find_repeated(names: Iterable[str], place: str = "scenarios") -> Iterator[str]:
    """Yield a sentence about every name that occurs more than once."""
    for name, count in Counter(names).items():
        if count > 1:
            yield f"{place}: expected every id once, found {name!r} {count} times"


def _find_range_faults(place: str, part: Means | EgoResult | Infraction | Speeding, mode: ScoreMode) -> Iterator[str]:
    for name, (low, high) in RANGES.items():
        value = getattr(part, name, None)
        if name == "ds" and mode is ScoreMode.INTERDRIVE_ASIS:
            high = math.inf  # the published aggregation can exceed 100
        if value is not None and not low <= value <= high + SUM_TOLERANCE:
            expected = f"{low:g} to {high:g}" if high < LARGEST or value > low else f"at least {low:g}"
            yield f"{place}.{name}: expected {expected}, found {format_leaf(value)}"


def _find_ego_faults(place: str, ego: EgoResult, ticks: int) -> Iterator[str]:
    exact = _EgoFactors(ego.rc, ego.infractions)
    if abs(ego.ip - exact.ip) > SUM_TOLERANCE * (1 + len(ego.infractions)):
        yield f"{place}.ip: expected the product of its infractions' factors, {exact.ip:.6f}, found {ego.ip}"
    if abs(ego.ds - ego.rc * exact.ip) > SCORE_TOLERANCE:
        yield f"{place}.ds: expected RC x IP, {ego.rc * exact.ip:.6f}, found {ego.ds}"
    if ego.ticks is not None and ego.ticks > ticks:
        yield f"{place}.ticks: expected at most the {ticks} of the episode, found {ego.ticks}"
    if ego.time_ratio is not None and ego.outcome is not End.ARRIVED:
        yield f"{place}.time_ratio: expected null for a CAV that did not arrive, found {ego.time_ratio}"


def _find_mean_faults(place: str, result: ScenarioResult, mode: ScoreMode) -> Iterator[str]:
    """Compare the scores of a scenario with those that its CAVs give."""
    if result.status == "void":
        figures = result.model_dump(include={"ds", "sr", "rc", "ip"})
        yield from map(str, find_tree_differences(dict.fromkeys(figures, 0.0), figures, place))
        if result.egos:
            yield f"{place}.egos: expected none in a void scenario, found {len(result.egos)}"
        return
    if not result.egos:
        yield f"{place}.egos: expected at least one, found none"
        return
    for ego in result.egos:
        if (ego.time_factor is None) == (mode is ScoreMode.HARD):
            expected = "a factor in score mode hard" if mode is ScoreMode.HARD else f"none in score mode {mode}"
            yield f"{place}.egos[{ego.id}].time_factor: expected {expected}, found {ego.time_factor}"
    exact = compute_scenario_means([_EgoFactors(ego.rc, ego.infractions, ego.time_factor) for ego in result.egos], mode)
    is_close = any(abs(value - SUCCESS_DS) <= SCORE_TOLERANCE for value in (exact.ds, *(ego.ds for ego in result.egos)))
    names = {"ds", "rc", "ip"} | (set() if is_close else {"sr"})
    expected, found = exact.model_dump(include=names), result.model_dump(include=names)
    yield from map(str, find_tree_differences(expected, found, place, SCORE_TOLERANCE * max(1.0, exact.ds / 100.0)))
    yield from _find_time_faults(place, result, mode)


def _find_time_faults(place: str, result: ScenarioResult, mode: ScoreMode) -> Iterator[str]:
    ratios = [ego.time_ratio for ego in result.egos if ego.time_ratio is not None]
    expected: dict[str, float | None] = {
        "time_ratio": compute_mean(ratios) if ratios and len(ratios) == len(result.egos) else None
    }
    if result.efficient_sr is not None:
        expected["efficient_sr"] = compute_efficient_sr(result.sr, result.egos, mode)
    found = result.model_dump(include=set(expected))
    yield from map(str, find_tree_differences(expected, found, place, SUM_TOLERANCE))


def _find_track_faults(results: Results) -> Iterator[str]:
    expected = join_sensing_tracks(one.sensing_track for one in results.scenarios if one.status != "void")
    if results.run.sensing_track != expected:
        found = format_leaf(results.run.sensing_track)
        yield f"run.sensing_track: expected {expected!r} as the scenarios say, found {found}"


def _find_summary_faults(results: Results) -> Iterator[str]:
    """Compare the means over buckets and the run with those that the scenarios give."""
    exact = {
        "overall": compute_overall(results.scenarios).model_dump(),
        "buckets": {name: one.model_dump() for name, one in compute_bucket_means(results.scenarios).items()},
        "void": sum(scenario.status == "void" for scenario in results.scenarios),
    }
    found = results.model_dump(include=set(exact))
    yield from map(str, find_tree_differences(exact, found, tolerance=SUM_TOLERANCE))
