"""The command line: `mdrive-sumo COMMAND`. A command's module is imported only when it is called."""

from collections.abc import Mapping
from importlib import import_module

import click

from mdrive_sumo import __version__
from mdrive_sumo.cli.plug_in_commands import find_help_line, find_plug_ins, load_command
from mdrive_sumo.core.clean_text import clean_for_terminal, clean_line
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.suggestion import shorten_name, suggest_name

PLUG_IN_GROUP = "mdrive_sumo.commands"
"""Entry points through which other packages add commands."""

COMMANDS: Mapping[str, tuple[str, str]] = {
    "eval": ("evaluate", "Drive a suite with an agent and score it."),
    "eval-open": ("evaluate_open", "Compare an agent's plans and detections with recorded drives."),
    "list": ("list", "List suites, scenarios, agents, networks, metrics, plug-ins or runs."),
    "show": ("show", "Draw a scenario or a network."),
    "view": ("view", "See in the browser what each CAV lost, compare runs, replay an episode."),
    "explain": ("explain", "Tell in sentences what a CAV did and why."),
    "negotiate": ("negotiate", "Hold one round of a negotiation at a tick of a drive; take part if you wish."),
    "render": ("render", "Draw a recorded episode as a picture or a video."),
    "export": ("export", "Write recorded episodes for Foxglove, CommonRoad, SUMO, OpenSCENARIO, pandas, ..."),
    "verify": ("verify", "Execute a run again and compare every tick."),
    "rescore": ("rescore", "Score a run's recordings again, without simulation."),
    "compare": ("compare", "Compare two runs scenario by scenario."),
    "report": ("report", "Write tables and figures over several runs: HTML, Markdown, LaTeX, CSV."),
    "study": ("study", "Measure cooperation: the paper's tables, worse channels, the value of messages."),
    "validate": ("validate", "Check that a suite is sound, difficult and solvable."),
    "reference-times": ("reference_times", "Write when `omniscient` arrived in a run, beside its suite."),
    "generate": ("generate", "Generate scenarios: proposed, placed, checked, driven."),
    "learn": ("learn", "Train systems that see through cameras: data, training, evaluation, export."),
    "schema": ("schema", "Print a file format as JSON Schema."),
    "doctor": ("doctor", "Show what is installed and what is missing for which command."),
}
"""Command -> its module in this package and one line of help."""


class InputProblem(click.ClickException):
    """Unusable input: one sentence, exit code 2."""

    exit_code = 2

    def format_message(self) -> str:
        """Return the sentence as a terminal may show it."""
        return clean_line(self.message)


class CommandLine(click.Group):
    """The commands of `COMMANDS` and of other packages, imported when they are called."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 (click's signature)
        """Return the own commands in the order of their use, then those of other packages."""
        return [*COMMANDS, *sorted(find_plug_ins(PLUG_IN_GROUP))]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """Import a command."""
        from mdrive_sumo.cli.strict_parsing import make_strict  # here, so that --help need not import it

        if cmd_name in COMMANDS:
            return make_strict(import_module(f"mdrive_sumo.cli.{COMMANDS[cmd_name][0]}").command)
        plug_in = find_plug_ins(PLUG_IN_GROUP).get(cmd_name)
        return make_strict(load_command(plug_in)) if plug_in else None

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find a command. Raises click.UsageError with a suggestion for a mistyped name."""
        name = args[0]
        if not name.startswith("-") and self.get_command(ctx, name) is None:
            suggestion = suggest_name(name, self.list_commands(ctx))
            ctx.fail(f"expected a command, found {shorten_name(name)}{suggestion or '; --help lists the commands'}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """Write one line per command without importing any."""
        own = [(name, text) for name, (_, text) in COMMANDS.items()]
        others = [
            (name, find_help_line(plug_in, name)) for name, plug_in in sorted(find_plug_ins(PLUG_IN_GROUP).items())
        ]
        with formatter.section("Commands"):
            formatter.write_dl([*own, *others])

    def invoke(self, ctx: click.Context) -> object:
        """Run a command; an InputError ends in one sentence and exit code 2, Ctrl-C in 130."""
        try:
            return super().invoke(ctx)
        except InputError as error:
            raise InputProblem(str(error)) from None
        except click.ClickException as problem:  # it may name a stranger's file
            vars(problem)["message"] = clean_for_terminal(problem.message)
            raise
        except KeyboardInterrupt:
            ctx.exit(130)


@click.command(cls=CommandLine, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="mdrive-sumo")
def main() -> None:
    """MDrive on SUMO: closed-loop cooperative driving, from one command to a score that anyone can re-run.

    Start with `mdrive-sumo eval`. Exit codes: 0 done, 1 something is void or differs or an agent failed, 2 unusable
    input, 130 interrupted.
    """
    # Here, so that --help need not import them.
    from mdrive_sumo.core.compiled import format_notice
    from mdrive_sumo.core.terminal import echo

    if notice := format_notice():
        echo(notice, err=True)
