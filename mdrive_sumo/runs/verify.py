"""`verify`: execute a run again; compare every tick with the recording, and every number of its files."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from mdrive_sumo.agent_process.agent_lookup import find_carla_file
from mdrive_sumo.contract import EXCHANGE
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.core.state import DT
from mdrive_sumo.core.tree_difference import find_tree_differences, format_leaf
from mdrive_sumo.episode import EpisodeRecord, load_episode
from mdrive_sumo.loop.recorded_actions import RecordedActions
from mdrive_sumo.runs.episode_cost import estimate_cost
from mdrive_sumo.runs.episode_difference import find_content_difference, find_first_difference
from mdrive_sumo.runs.episode_job import EpisodeJob, make_reexecution, make_silent_job, reexecute, score_job_episode
from mdrive_sumo.runs.evaluate import RESULTS_FILE
from mdrive_sumo.runs.journal import JournalText, find_entry_key
from mdrive_sumo.runs.prepared_run import PreparedRun, make_run_info
from mdrive_sumo.runs.process_pool import FailureKind, ProcessPool, WorkerFailure
from mdrive_sumo.scenario.reference_times import NO_REFERENCE
from mdrive_sumo.scoring import (
    EpisodeKey,
    Results,
    RunInfo,
    ScenarioResult,
    ScoreMode,
    apply_reference_times,
    find_scenario_faults,
    summarize_run,
)
from mdrive_sumo.scoring.results_check import find_repeated_episodes, name_place


@dataclass(frozen=True, slots=True)
class VerificationJob:
    """A scenario to execute again, and its final digest, the only reference without a recording."""

    job: EpisodeJob
    digest: str
    modes: tuple[ScoreMode, ...] = ()
    """Score modes of which the run folder has results."""


@dataclass(frozen=True, slots=True)
class VerificationResult:
    """Whether a scenario is reproduced, and a sentence about the comparison."""

    scenario: str
    """Its id, with the seed in a run of several."""
    identical: bool
    """Whether the episode is the recorded one, tick by tick."""
    text: str
    scores: Mapping[ScoreMode, ScenarioResult] = field(default_factory=lambda: {})
    """The scores of the second execution by score mode; empty if it failed."""
    key: EpisodeKey = ("", 0)
    """Scenario and seed."""
    replayed: str = ""
    """What was taken from the recording because it cannot be repeated, e.g. "1 agent failure"; "" if nothing was."""


def sample_results(results: Results, size: int | None) -> tuple[ScenarioResult, ...]:
    """Return the scenarios to verify in the order of the suite: all that are not void, or `size` of them.

    The choice depends only on the seeds and the scenario ids.
    """
    finished = [result for result in results.scenarios if result.status != "void"]
    drawn = sorted(finished, key=lambda result: derive_seed(result.seed, result.id, "verify"))[:size]
    return tuple(result for result in finished if result in drawn)


def verify(
    run: PreparedRun, chosen: Sequence[ScenarioResult], workers: int, modes: Sequence[ScoreMode] = ()
) -> Iterator[VerificationResult]:
    """Yield the comparison of every chosen scenario, in the order in which they finish. Raises InputError.

    modes: the score modes to score each of them in. Third-party agents run: see `permit_agent`.
    """
    scenarios = {scenario.id: scenario for scenario in run.scenarios}
    result_by_key = {key: result for result in chosen if (key := run.find_key(result)) in run.episodes}

    def estimate(item: tuple[EpisodeKey, ScenarioResult]) -> float:
        key, result = item
        return estimate_cost(scenarios[key[0]], run.suite.find_folder(key[0]), result.ticks)

    checks = [  # the longest first, so that no worker idles at the end
        VerificationJob(run.make_job(scenarios[key[0]], key[1]), result.digest, tuple(modes))
        for key, result in sorted(result_by_key.items(), key=estimate, reverse=True)
    ]
    with ProcessPool[VerificationJob, VerificationResult](
        verify_episode, min(workers, max(len(checks), 1)), run.limit_s()
    ) as pool:
        for check, outcome in pool.run(checks):
            key = (check.job.scenario, check.job.seed)
            if not isinstance(outcome, WorkerFailure):
                yield replace(outcome, scenario=run.name_episode(key), key=key)
            elif outcome.kind is FailureKind.INPUT:
                raise InputError(outcome.reason)
            else:
                yield VerificationResult(run.name_episode(key), False, outcome.reason, key=key)


def verify_episode(check: VerificationJob) -> VerificationResult:
    """Execute one scenario again, compare it with its recording and score it; runs in a worker."""
    job = check.job
    if job.recording is None:
        again = reexecute(make_silent_job(job))
        same = again.digest == check.digest
        text = f"final digest {again.digest}" + ("" if same else f", was {check.digest}") + " (no recording)"
        return VerificationResult(job.scenario, same, text, _score(check, again))
    recorded = load_episode(job.recording)
    again_job = make_reexecution(job, recorded)
    again = reexecute(again_job)
    text = _compare(check, recorded, again)
    identical = not text
    text = text or f"identical ({recorded.ticks} ticks)"
    replayed = _describe_replayed(recorded, again_job)
    return VerificationResult(job.scenario, identical, text, _score(check, again), replayed=replayed)


def _compare(check: VerificationJob, recorded: EpisodeRecord, again: EpisodeRecord) -> str:
    """Return a sentence about the first difference; "" if there is none."""
    if recorded.digest != check.digest:
        return f"the recording's digest is {recorded.digest}, that of the results {check.digest}"
    difference = find_first_difference(recorded, again) or find_content_difference(recorded, again)
    if difference is None:
        return ""
    return f"first difference at tick {difference.tick} ({difference.tick * DT:.2f} s): {difference.text}"


def _score(check: VerificationJob, again: EpisodeRecord) -> dict[ScoreMode, ScenarioResult]:
    return {mode: score_job_episode(replace(check.job, score_mode=mode), again) for mode in check.modes}


def _describe_replayed(recorded: EpisodeRecord, job: EpisodeJob) -> str:
    """Return what a second execution takes from the recording; a run's word is taken for these alone."""
    people = [source for source in job.actions.values() if isinstance(source, RecordedActions)]
    counts = {
        "ticks of controls of people": sum(len(source.list_person_ticks()) for source in people),
        "agent failures": sum(ending.failure is not None for ending in recorded.endings),
        "thinking times": len(recorded.thinking),
        "answers of a language model": sum(record.note.kind == EXCHANGE for record in recorded.notes),
    }
    return ", ".join(f"{count} {name}" for name, count in counts.items() if count)


Scores = Mapping[EpisodeKey, Mapping[ScoreMode, ScenarioResult]]
"""The scores of the second execution by episode and score mode."""
TIMES = {"time_ratio", "efficient_sr"}
"""Figures that a journal may hold by older reference times than the results."""
ENTERED = ("agent", "command")
"""What the user typed: nothing follows from it."""


@dataclass(frozen=True, slots=True)
class ExpectedResults:
    """What a results file must contain."""

    results: Results
    missing: tuple[str, ...]
    """Scenarios that the run has to have, and the file does not."""
    foreign: tuple[str, ...]
    """Scenarios that the file has, and the run cannot have."""


def build_expected_results(
    run: PreparedRun, found: Results, scores: Scores, mode: ScoreMode, facts: Mapping[str, Any]
) -> ExpectedResults:
    """Return what a results file of this score mode must contain.

    found: the file, whose void scenarios, and those without a score in `scores`, are taken as they are. facts: labels
    and declared label that the agent has now.
    """
    stored = {run.find_key(result): result for result in found.scenarios}
    episodes = [*run.episodes]
    scenarios = [_expect_scenario(stored[key], scores.get(key, {}), mode) for key in episodes if key in stored]
    info = _expect_info(run, found.run, mode, facts)
    return ExpectedResults(
        summarize_run(info, scenarios or list(found.scenarios)),
        tuple(run.name_episode(key) for key in episodes if key not in stored),
        tuple(run.name_episode(key) for key in stored if key not in episodes),
    )


def find_results_differences(expected: ExpectedResults, found: Results) -> Iterator[str]:
    """Yield a sentence (place, expected, found) for every value of a results file that is not as it must be."""
    mode = ScoreMode(expected.results.run.score_mode)
    seeds = expected.results.run.all_seeds
    yield from find_repeated_episodes(found.scenarios)
    for name in expected.missing:
        yield f"scenarios: expected {name!r}, which the run drives, found nothing"
    for name in expected.foreign:
        yield f"scenarios: expected scenarios of the run only, found {name!r:.80}"
    info = found.run.model_dump(mode="json", include=found.run.model_fields_set)
    same = expected.results.run.model_dump(mode="json", include=found.run.model_fields_set)
    yield from map(str, find_tree_differences(same, info, "run"))
    parts = {"overall", "buckets", "void"}
    summary, stated = (one.model_dump(mode="json", include=parts) for one in (expected.results, found))
    yield from map(str, find_tree_differences(summary, stated))
    run = expected.results.run
    right = {run.find_key(result): result.model_dump(mode="json") for result in expected.results.scenarios}
    for result in found.scenarios:
        if (key := run.find_key(result)) in right:
            found_values = result.model_dump(mode="json")
            yield from map(str, find_tree_differences(right[key], found_values, name_place(result, seeds)))
            if right[key] == found_values:  # perhaps because it was not executed again
                yield from find_scenario_faults(result, mode, seeds)


def find_journal_differences(journal: JournalText, expected: Results) -> Iterator[str]:
    """Yield a sentence for every value of the journal's last results that is not as it must be."""
    is_seeded = len(expected.run.all_seeds) > 1
    last = {_find_entry(entry, expected.run): entry for entry in journal.results}
    for result in expected.scenarios:
        name = f"{result.id}, seed {result.seed}" if is_seeded else result.id
        if (entry := last.get(expected.run.find_key(result))) is None:
            yield f"results: expected one of {name!r}, found none"
            continue
        right = result.model_dump(mode="json")
        yield from map(str, find_tree_differences(_drop_times(right), _drop_times(entry), f"results[{name}]"))


def _find_entry(entry: Mapping[str, Any], run: RunInfo) -> EpisodeKey:
    """As `RunInfo.find_key`, of an entry of the journal."""
    key = find_entry_key(entry)
    return key if len(run.all_seeds) > 1 else (key[0], run.seed)


def find_fingerprint_differences(run: PreparedRun) -> Iterator[str]:
    """Yield a sentence if the journal's fingerprint names another suite than the results."""
    noted = run.fingerprint.get("suite_checksum")
    if noted != run.info.suite_checksum:
        stated = format_leaf(noted)
        yield f"fingerprint.suite_checksum: expected {run.info.suite_checksum!r} as in {RESULTS_FILE}, found {stated}"


def _expect_scenario(
    stored: ScenarioResult, scores: Mapping[ScoreMode, ScenarioResult], mode: ScoreMode
) -> ScenarioResult:
    again = scores.get(mode, stored)
    if not stored.sensing_track:  # driven before tracks existed; the run then claims none
        again = again.model_copy(update={"sensing_track": ""})
    if stored.efficient_sr is None:  # scored before its suite had reference times
        return apply_reference_times(again, NO_REFERENCE, mode)
    return again


def _expect_info(run: PreparedRun, found: RunInfo, mode: ScoreMode, facts: Mapping[str, Any]) -> RunInfo:
    """Return the description of the run: options from the fingerprint, labels from the agent, versions as noted."""
    made = make_run_info(run.config, run.suite, tuple(facts["labels"]), str(facts["declared_label"]))
    noted = {name: run.fingerprint.get(name) for name in found.versions}
    versions = {name: str(version) for name, version in noted.items() if version is not None}
    same = {name: getattr(found, name) for name in ENTERED if name != "agent" or _is_same_agent(run, found)}
    return made.model_copy(update={"score_mode": str(mode), "versions": versions, **same})


def _is_same_agent(run: PreparedRun, found: RunInfo) -> bool:
    """Return whether the agent of the results is that of the fingerprint, whose path is absolute."""
    return _shorten_locator(run.config.agent.name) == _shorten_locator(found.agent)


def _shorten_locator(name: str) -> str:
    """Return a locator without its folder and without what `carla:` was resolved to."""
    file = find_carla_file(name)
    return file.name if file is not None else name.rpartition("/")[2]


def _drop_times(value: Any) -> Any:
    """Return a result without the figures that depend on reference times."""
    if isinstance(value, Mapping):
        return {name: _drop_times(inner) for name, inner in value.items() if name not in TIMES}
    return [_drop_times(entry) for entry in value] if isinstance(value, list) else value
