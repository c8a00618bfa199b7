"""`mdrive-sumo validate`."""

import click

from mdrive_sumo.cli.evaluate import workers_option
from mdrive_sumo.scenario.catalog import load_suite
from mdrive_sumo.validate import Examination, examine_suite, sampled, suite_problems


@click.command("validate")
@click.argument("suite")
@click.option("--sample", type=click.IntRange(min=1), metavar="N", help="Only N scenarios, always the same ones.")
@workers_option
@click.pass_context
def command(ctx: click.Context, suite: str, sample: int | None, workers: int) -> None:
    """Check that a suite is sound (lanes, starts), difficult (blind driving has a near miss) and solvable
    (`omniscient` reaches DS 100); the built-in one also against the paper's statistics.

    Exit codes: 0 everything passes, 1 something fails, 2 unusable input.
    """
    loaded = load_suite(suite)
    found: list[Examination] = []
    for one in examine_suite(loaded, sampled(loaded, sample), workers):
        found.append(one)
        click.echo(f"{one.scenario}: {'; '.join(one.problems) or 'ok'}{', hidden until late' if one.hidden else ''}")
    whole = suite_problems(loaded, found)
    for problem in whole:
        click.echo(f"{loaded.name}: {problem}")
    failed = sum(bool(one.problems) for one in found)
    click.echo(f"{len(found) - failed} of {len(found)} pass; {sum(one.hidden for one in found)} hidden until late")
    ctx.exit(1 if failed or whole else 0)
