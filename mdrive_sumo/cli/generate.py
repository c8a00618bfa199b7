"""`mdrive-sumo generate`."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from mdrive_sumo.errors import InputError
from mdrive_sumo.generate import llm
from mdrive_sumo.generate.category import CATEGORIES, Category
from mdrive_sumo.generate.search import TRIES, Attempt, Order, Proposer, by_template, search
from mdrive_sumo.generate.suite import changed_by_rebuild, check_new, rebuilt, recipes_of, write_generated
from mdrive_sumo.scenario.catalog import SuiteFile, load_suite, packaged_suites
from mdrive_sumo.scenario.spec import Scenario

FOLDER = click.Path(path_type=Path, file_okay=False)


def _model_options(function: Callable[..., None]) -> Callable[..., None]:
    options = (
        click.option("--endpoint", default="", help="llm: address of an OpenAI-compatible service."),
        click.option("--model", default="default", show_default=True, help="llm: its model."),
        click.option("--api-key-env", default="", metavar="NAME", help="llm: environment variable with the key."),
        click.option("--attempts", default=3, show_default=True, help="llm: requests for one proposal."),
        click.option("--examples", type=FOLDER, help="llm: folder of expert demonstrations (proposals as JSON)."),
        click.option("--transcripts", type=FOLDER, help="llm: folder that keeps every exchange."),
        click.option("--replay", type=FOLDER, help="llm: such a folder; nothing is asked."),
    )
    for option in reversed(options):
        function = option(function)
    return function


@click.command("generate")
@click.option("--category", type=click.Choice([c.value for c in Category]), help="Kind of interaction.")
@click.option("--count", type=click.IntRange(1, 1000), default=10, show_default=True, help="How many scenarios.")
@click.option("--proposer", type=click.Choice(("template", "llm")), default="template", show_default=True)
@click.option("--seed", default=0, show_default=True)
@click.option("--split", type=click.Choice(("public", "hidden")), default="public", show_default=True)
@click.option("--seed-file", type=click.Path(path_type=Path, dir_okay=False), help="hidden: file with a private seed.")
@click.option("--out", type=FOLDER, help="New suite folder.")
@click.option("--explain", is_flag=True, help="Print every proposal that was refused, at which stage and why.")
@click.option("--rebuild", metavar="SUITE", help="Make SUITE again from its recipes and compare, or write it to --out.")
@_model_options
@click.pass_context
def command(ctx: click.Context, rebuild: str | None, category: str | None, out: Path | None, **options: Any) -> None:
    """Generate scenarios: proposed, placed on a network, checked, driven blindly and by `omniscient`.

    Exit codes: 0 done, 1 fewer scenarios than asked for (or a rebuilt one differs), 2 unusable input.
    """
    if rebuild is not None:
        ctx.exit(_rebuild(rebuild, out))
    if category is None or out is None:
        raise click.UsageError("expected --category and --out (or --rebuild), found none")
    check_new(out)
    order = Order(Category(category), options["count"], options["seed"], options["split"], _secret(options))
    ctx.exit(_generate(order, _proposer(options), out, options["explain"]))


def _secret(options: dict[str, Any]) -> str:
    if (options["split"] == "hidden") != (options["seed_file"] is not None):
        raise click.UsageError("expected --seed-file together with --split hidden, found one without the other")
    if options["seed_file"] is None:
        return ""
    try:
        secret = options["seed_file"].read_text().strip()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{options['seed_file']}: cannot be read as a private seed: {error}") from None
    if len(secret) < 16:
        raise InputError(
            f"{options['seed_file']}: expected a private seed of 16 characters or more, found {len(secret)}"
        )
    return secret


def _proposer(options: dict[str, Any]) -> tuple[Proposer, str]:
    if options["proposer"] == "template":
        return by_template, "template"
    names = ("endpoint", "model", "api_key_env", "attempts", "examples", "transcripts", "replay")
    settings = llm.LlmSettings(**{name: options[name] for name in names})

    def propose(category: Category, seed: str):
        return llm.propose(category, seed, settings)

    return propose, f"llm:{settings.model}"


def _generate(order: Order, proposer: tuple[Proposer, str], out: Path, explain: bool) -> int:
    known = _known(order)
    found: list[Attempt] = []
    for attempt in search(order, proposer[0], known, proposer[1]):
        if explain:
            click.echo(_explained(attempt))
        if attempt.scenario is not None:
            found.append(attempt)
    if not found:
        raise InputError(f"{order.category}: expected a scenario from {order.count * TRIES} proposals, found none")
    title = f"{CATEGORIES[order.category].title}, generated"
    about = SuiteFile(name=out.name, title=title, description=f"{order.split} split, {proposer[1]}, seed {order.seed}")
    write_generated(about, [(a.recipe, a.scenario) for a in found if a.recipe and a.scenario], out)
    click.echo(f"{len(found)} of {order.count} scenarios: {out}")
    return 0 if len(found) == order.count else 1


def _known(order: Order) -> list[Scenario]:
    """Public scenarios of the category: what is generated shall not be like them."""
    suites = [load_suite(name) for name in packaged_suites()]
    return [scenario for suite in suites for scenario in suite.scenarios if scenario.category == order.category]


def _explained(attempt: Attempt) -> str:
    if attempt.scenario is not None and attempt.screened is not None:
        ttc = attempt.screened.blind_ttc_s
        return f"proposal {attempt.number}: {attempt.scenario.id} on {attempt.scenario.network}, blind TTC {ttc:.2f} s"
    stage, reason = attempt.rejected or ("", "")
    return f"proposal {attempt.number}: refused at {stage}: {reason}"


def _rebuild(name: str, out: Path | None) -> int:
    suite = load_suite(name)
    recipes = recipes_of(suite)
    if out is not None:
        write_generated(suite.about, [(recipe, rebuilt(recipe)) for recipe in recipes], out)
        click.echo(f"{len(recipes)} scenarios: {out}")
        return 0
    changed = changed_by_rebuild(suite, recipes)
    for scenario in changed:
        click.echo(f"{scenario}: the recipe makes another file")
    click.echo(f"{len(recipes) - len(changed)} of {len(recipes)} scenarios are as their recipes make them")
    return 1 if changed else 0
