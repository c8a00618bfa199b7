"""`mdrive-sumo generate`."""

import json
from collections import Counter
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import click
from pydantic import ValidationError

from mdrive_sumo.cli.generate_hard import check_hard_options, generate_hard, hard_options
from mdrive_sumo.cli.generate_season import check_season_options, generate_season, read_secret, season_options
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_text
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.generate import llm_proposer
from mdrive_sumo.generate.category_requirements import CATEGORIES, Category
from mdrive_sumo.generate.generated_suite import (
    check_output_folder,
    find_rebuild_differences,
    load_packaged_generated,
    load_recipes,
    write_generated_suite,
    write_rebuilt_suite,
)
from mdrive_sumo.generate.generation_search import (
    GenerationAttempt,
    GenerationRequest,
    Proposer,
    build_public_counterparts,
    propose_from_template,
    search_scenarios,
)
from mdrive_sumo.generate.hard.suite_requirements import LEAST_SCENARIOS
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import SuiteFile, load_suite

FOLDER = click.Path(path_type=Path, file_okay=False)
COUNT = 10
"""Scenarios of a command that says no number; chosen: enough to look at."""


def _model_options(function: Callable[..., None]) -> Callable[..., None]:
    options = (
        click.option("--endpoint", default="", help="llm: address of an OpenAI-compatible service."),
        click.option("--model", default="default", show_default=True, help="llm: its model."),
        click.option("--api-key-env", default="", metavar="NAME", help="llm: environment variable with the key."),
        click.option("--attempts", default=3, show_default=True, help="llm: requests for one proposal."),
        click.option("--timeout", "timeout_s", default=60.0, show_default=True, help="llm: for one request [s]."),
        click.option("--temperature", default=0.7, show_default=True, help="llm: how varied its answers are."),
        click.option("--examples", type=FOLDER, help="llm: folder of expert demonstrations (proposals as JSON)."),
        click.option("--transcripts", type=FOLDER, help="llm: folder that keeps every exchange."),
        click.option("--replay", type=FOLDER, help="llm: such a folder; nothing is asked."),
    )
    for option in reversed(options):
        function = option(function)
    return function


@click.command("generate")
@click.option("--category", type=click.Choice([c.value for c in Category]), help="Kind of interaction.")
@click.option(
    "--count", type=click.IntRange(1, 1000), help=f"How many scenarios.  [default: {COUNT}; --hard: {LEAST_SCENARIOS}]"
)
@click.option("--proposer", type=click.Choice(("template", "llm")), default="template", show_default=True)
@click.option("--seed", default=0, show_default=True)
@click.option("--split", type=click.Choice(("public", "hidden")), default="public", show_default=True)
@click.option("--seed-file", type=click.Path(path_type=Path, dir_okay=False), help="hidden: file with a private seed.")
@click.option("--out", type=FOLDER, help="New suite folder.")
@click.option("--explain", is_flag=True, help="Print every proposal that was refused, at which stage and why.")
@click.option("--rebuild", metavar="SUITE", help="Make SUITE again from its recipes and compare, or write it to --out.")
@hard_options
@season_options
@_model_options
@click.pass_context
def command(ctx: click.Context, rebuild: str | None, category: str | None, out: Path | None, **options: Any) -> None:
    """Generate scenarios: proposed, placed on a network, checked, driven blindly and by `omniscient`.

    --season draws a whole season of the benchmark (docs/seasons.md), --hard --season one of the hard tier: scenarios
    that `omniscient` solves and rules without messages do not (docs/hard.md). Ctrl-C stops either, the same command
    continues it.

    Exit codes: 0 done, 1 fewer scenarios than asked for (or a rebuilt one differs), 2 unusable input.
    """
    if rebuild is not None:
        ctx.exit(_rebuild_suite(rebuild, out))
    check_hard_options(options)
    if options["hard"]:
        if out is None:
            raise click.UsageError("--hard: expected --out, found none")
        ctx.exit(generate_hard(ctx, options, out))
    check_season_options(options)
    if options["season"] is not None:
        if out is None:
            raise click.UsageError("--season: expected --out, found none")
        ctx.exit(generate_season(ctx, options, out))
    if category is None or out is None:
        raise click.UsageError("expected --category and --out (or --season, --hard or --rebuild), found none")
    order = GenerationRequest(
        Category(category), options["count"] or COUNT, options["seed"], options["split"], _read_secret(options)
    )
    ctx.exit(_generate(order, _choose_proposer(options), out, options["explain"]))


def _read_secret(options: dict[str, Any]) -> str:
    if (options["split"] == "hidden") != (options["seed_file"] is not None):
        raise click.UsageError("expected --seed-file together with --split hidden, found one without the other")
    if options["seed_file"] is None:
        return ""
    return read_secret(options["seed_file"])


def _choose_proposer(options: dict[str, Any]) -> tuple[Proposer, str]:
    if options["proposer"] == "template":
        return propose_from_template, "template"
    settings = llm_proposer.LlmSettings(
        **{field.name: options[field.name] for field in fields(llm_proposer.LlmSettings)}
    )

    def propose(category: Category, seed: str):
        return llm_proposer.propose(category, seed, settings)

    return propose, f"llm:{_read_recorded_model(settings.replay) if settings.replay else settings.model}"


def _read_recorded_model(folder: Path) -> str:
    """Return the name of the model whose exchanges a folder holds."""
    try:
        first = read_text(sorted(folder.glob("*.jsonl"))[0]).partition("\n")[0]
        return str(json.loads(first)["request"]["model"])
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        raise InputError(f"--replay {folder}: expected transcripts of an earlier run, found none") from None


def _describe_suite(order: GenerationRequest, proposer: str, out: Path) -> SuiteFile:
    title = f"{CATEGORIES[order.category].title}, generated"
    about = f"{order.split} split, {proposer}, seed {order.seed}"
    try:
        return SuiteFile(name=out.name, title=title, description=about)
    except ValidationError:
        raise InputError(
            f"--out {out}: expected a folder name of letters, digits and _.+- (at most 80), found {out.name!r}"
        ) from None


def _generate(order: GenerationRequest, proposer: tuple[Proposer, str], out: Path, explain: bool) -> int:
    check_output_folder(out)
    about = _describe_suite(order, proposer[1], out)
    attempts: list[GenerationAttempt] = []
    for attempt in search_scenarios(order, proposer[0], _list_known(order), proposer[1]):
        attempts.append(attempt)
        if explain:
            echo(_format_attempt(attempt))
    made = [(one.recipe, one.scenario) for one in attempts if one.recipe and one.scenario]
    refused = Counter(one.rejection[0] for one in attempts if one.rejection)
    summary = ", ".join(f"{count} at {stage}" for stage, count in refused.most_common())
    if not made:
        last = attempts[-1].rejection or ("", "")
        raise InputError(
            f"{order.category}: expected a scenario from {len(attempts)} proposals, found none ({summary});"
            f" the last one: {last[1]}"
        )
    write_generated_suite(about, made, out)
    if refused and (explain or len(made) < order.count):
        echo(f"refused of {len(attempts)} proposals: {summary}")
    echo(f"{len(made)} of {order.count} scenarios: {out}")
    return 0 if len(made) == order.count else 1


def _list_known(order: GenerationRequest) -> list[Scenario]:
    """Return the public scenarios, which generated ones must differ from."""
    public = [scenario for scenario in load_packaged_generated() if scenario.category == order.category]
    return public + list(build_public_counterparts(order)) if order.split == "hidden" else public


def _format_attempt(attempt: GenerationAttempt) -> str:
    if attempt.scenario is not None and attempt.screening is not None:
        ttc = attempt.screening.blind_ttc_s
        return f"proposal {attempt.number}: {attempt.scenario.id} on {attempt.scenario.network}, blind TTC {ttc:.2f} s"
    stage, reason = attempt.rejection or ("", "")
    return f"proposal {attempt.number}: refused at {stage}: {reason}"


def _rebuild_suite(name: str, out: Path | None) -> int:
    recipes = load_recipes(name)
    if out is not None:
        write_rebuilt_suite(load_suite(name), recipes, out)
        echo(f"{len(recipes)} scenarios: {out}")
        return 0
    changed = 0
    for scenario in find_rebuild_differences(recipes):
        changed += 1
        echo(f"{scenario}: the recipe makes another file")
    echo(f"{len(recipes) - changed} of {len(recipes)} scenarios are as their recipes make them")
    return 1 if changed else 0
