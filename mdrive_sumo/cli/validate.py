"""`mdrive-sumo validate`."""

from collections.abc import Sequence

import click

from mdrive_sumo.certificate import CERTIFICATE_FILE, CertificateFile, save_certificates
from mdrive_sumo.cli.evaluate import workers_option
from mdrive_sumo.scenario.catalog import Suite, load_suite
from mdrive_sumo.suite.run import writing
from mdrive_sumo.validate import Examination, examine_suite, sampled, suite_problems


@click.command("validate")
@click.argument("suite")
@click.option("--sample", type=click.IntRange(min=1), metavar="N", help="Only N scenarios, always the same ones.")
@click.option("--write", is_flag=True, help="Keep the occlusion certificates beside the suite, for `list scenarios`.")
@workers_option
@click.pass_context
def command(ctx: click.Context, suite: str, sample: int | None, write: bool, workers: int) -> None:
    """Check that a suite is sound (lanes, starts), difficult (blind driving has a near miss) and solvable
    (`omniscient` reaches DS 100); the built-in one also against the paper's statistics.

    Exit codes: 0 everything passes, 1 something fails, 2 unusable input.
    """
    if write and sample:
        raise click.UsageError("--write needs all scenarios, so it does not go with --sample")
    loaded = load_suite(suite)
    found: list[Examination] = []
    for one in examine_suite(loaded, sampled(loaded, sample), workers):
        found.append(one)
        click.echo(f"{one.scenario}: {'; '.join(one.problems) or 'ok'}{', hidden until late' if one.hidden else ''}")
    whole = suite_problems(loaded, found)
    for problem in whole:
        click.echo(f"{loaded.name}: {problem}")
    if write:
        _write(loaded, found)
    failed = sum(bool(one.problems) for one in found)
    click.echo(f"{len(found) - failed} of {len(found)} pass; {sum(one.hidden for one in found)} hidden until late")
    ctx.exit(1 if failed or whole else 0)


def _write(suite: Suite, found: Sequence[Examination]) -> None:
    """Certificates in the order of the suite, of all scenarios that could be driven."""
    by_name = {one.scenario: one.certificate for one in found}
    kept = tuple(c for c in (by_name.get(scenario.id) for scenario in suite.scenarios) if c is not None)
    with writing(suite.folder / CERTIFICATE_FILE):
        save_certificates(suite.folder, CertificateFile(suite_checksum=suite.checksum(), certificates=kept))
    click.echo(f"{suite.folder / CERTIFICATE_FILE}  {len(kept)} certificates")
