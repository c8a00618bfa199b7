"""`mdrive-sumo validate`."""

from collections.abc import Sequence
from dataclasses import replace

import click

from mdrive_sumo.cli.options import scenario_option, workers_option
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.generate.validation import (
    HARD_SEEDS,
    ScenarioValidation,
    describe_rules,
    describe_suite,
    find_suite_problems,
    is_hard_suite,
    sample_scenarios,
    validate_scenarios,
)
from mdrive_sumo.runs.evaluate import report_write_errors
from mdrive_sumo.scenario.reference_times import (
    REFERENCE_TIMES_FILE,
    list_unmeasured,
    save_reference_times,
)
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import Suite, load_suite
from mdrive_sumo.study.need_certificate import NEED_FILE, NeedCertificateFile
from mdrive_sumo.study.occlusion_certificate import CERTIFICATE_FILE, OcclusionCertificateFile


@click.command("validate")
@click.argument("suite")
@click.option(
    "--sample",
    type=click.IntRange(min=1),
    metavar="N",
    help="Drive only N scenarios, always the same ones, of a suite's parts in proportion.",
)
@scenario_option
@click.option(
    "--write",
    is_flag=True,
    help="Write occlusion certificates and reference times beside the suite or each of its parts; with --scenario only"
    " those of the scenarios that are driven.",
)
@click.option(
    "--seeds",
    type=click.IntRange(1, 100),
    default=HARD_SEEDS,
    show_default=True,
    help="With how many seeds `omniscient` drives scenarios of the hard tier.",
)
@workers_option
@click.pass_context
def command(ctx: click.Context, suite: str, sample: int | None, scenario: str, write: bool, **options: int) -> None:
    """Check a suite, a name or a folder. Every file must be readable and as it was sealed.

    \b
    Every scenario must be
      sound      lanes connect, no road user starts inside another or a building
      difficult  constant-speed driving has a near miss (TTC < 0.9 s)
      solvable   `omniscient` reaches DS 100
    For recordings (buckets V2XPnP, Real2Sim) difficulty is reported, not required, and solvable means RC 100.

    The hard tier (bucket Hard) is not driven blindly. There `omniscient` must reach DS 100 with every seed, time
    limits must be its times x one factor from 1.15 to 1.5, + 2 s, and certificates of need are computed anew and
    compared with need.json.

    Suites named as the paper's are compared with its tables: scenarios, CAVs, routes, actors, categories, weather, and
    how many conflicts are hidden until late. Kept certificates, reference times (when `omniscient` arrives) and recipes
    must belong to the scenarios. The rules that scenarios exercise are counted (a stop sign on a route, a pedestrian in
    its way ...); those that none exercises are listed, and fail the whole packaged suite.

    Exit codes: 0 everything passes, 1 something fails, 2 unusable input.
    """
    if write and sample:
        raise click.UsageError("--write needs all scenarios, so it does not go with --sample")
    if sample and scenario != "*":
        raise click.UsageError("--sample draws from all scenarios, so it does not go with --scenario")
    loaded = load_suite(suite)
    chosen = loaded.select(scenario)
    written = [part for part in loaded.parts or (loaded,) if write and any(s in chosen for s in part.scenarios)]
    for part in written:
        _check_unchanged(part, chosen)
    validations: list[ScenarioValidation] = []
    sampled = sample_scenarios(replace(loaded, scenarios=chosen), sample)
    for validation in validate_scenarios(loaded, sampled, options["workers"], options["seeds"]):
        validations.append(validation)
        echo(_format_validation(validation))
    for part in written:
        (_write_need if is_hard_suite(part) else _write_certificates)(part, validations)
        _write_reference_times(part, validations)
    whole = find_suite_problems(loaded, validations)
    for sentence in (*whole, *describe_suite(loaded), *describe_rules(loaded)):
        echo(sentence)
    failed = sum(bool(validation.problems) for validation in validations)
    difficult = sum(validation.is_difficult for validation in validations)
    hidden = sum(validation.is_occluded for validation in validations)
    echo(f"{len(validations) - failed} of {len(validations)} pass; {difficult} difficult, {hidden} hidden until late")
    ctx.exit(1 if failed or whole else 0)


def _format_validation(validation: ScenarioValidation) -> str:
    if (hard := validation.hard) is not None:
        solved = f"ok, omniscient 100 with {hard.seeds} of {hard.seeds} seeds"
        proves = hard.need.proves
        need = f"proves {proves}: a message gains {hard.need.lead_s:.1f} s" if proves else "proves nothing of need"
        return f"{validation.scenario}: {'; '.join(validation.problems) or solved}; {need}"
    said = "; ".join(validation.problems) or ("ok" if validation.is_difficult else "ok, blind driving has no near miss")
    return f"{validation.scenario}: {said}{', hidden until late' if validation.is_occluded else ''}"


def _write_certificates(suite: Suite, validations: Sequence[ScenarioValidation]) -> None:
    count = OcclusionCertificateFile.write(suite, {one.scenario: one.certificate for one in validations})
    echo(f"{suite.folder / CERTIFICATE_FILE}  {count} certificates")


def _write_need(suite: Suite, validations: Sequence[ScenarioValidation]) -> None:
    found = {one.scenario: one.hard.need for one in validations if one.hard is not None}
    echo(f"{suite.folder / NEED_FILE}  {NeedCertificateFile.write(suite, found)} certificates")


def _write_reference_times(suite: Suite, validations: Sequence[ScenarioValidation]) -> None:
    measured = {
        validation.scenario: validation.reference for validation in validations if validation.reference is not None
    }
    with report_write_errors(suite.folder / REFERENCE_TIMES_FILE):
        count = save_reference_times(suite, measured)
    echo(f"{suite.folder / REFERENCE_TIMES_FILE}  times of {count} scenarios")


def _check_unchanged(suite: Suite, chosen: Sequence[Scenario]) -> None:
    """Raise InputError if a scenario that is not driven changed since the files were written: they keep its entries."""
    driven = {scenario.id for scenario in chosen}
    if changed := [name for name in list_unmeasured(suite) if name not in driven]:
        raise InputError(
            f"--write: expected {REFERENCE_TIMES_FILE} with every scenario outside --scenario as it is,"
            f" found none for {changed[0]}; --scenario has to include it"
        )
