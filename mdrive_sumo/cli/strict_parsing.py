"""Stricter parsing for all commands: no value is dropped without a word, and unknown names get a suggestion."""

from collections.abc import Callable, Sequence
from typing import Any

import click

from mdrive_sumo.core.suggestion import describe_unknown

Parse = Callable[[list[str]], tuple[dict[str, Any], list[str], list[click.Parameter]]]


class NameChoice(click.Choice[Any]):
    """A choice whose error says which value was probably meant."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the choice. Raises click.BadParameter."""
        names = [self.normalize_choice(choice, ctx) for choice in self.choices]
        if isinstance(value, str) and value not in names and self.case_sensitive:
            self.fail(describe_unknown(value, names), param, ctx)
        return super().convert(value, param, ctx)


def make_strict(command: click.Command) -> click.Command:
    """Make a command and all below it refuse an option that is given twice but has one value, and return it.

    click itself takes the last value. Choices become `NameChoice`s. Idempotent.
    """
    for param in command.params:
        if type(param.type) is click.Choice:
            param.type = NameChoice(param.type.choices, param.type.case_sensitive)
    if "make_parser" not in vars(command):
        command.make_parser = _wrap_parser(command.make_parser)
    if isinstance(command, click.Group):
        for child in command.commands.values():
            make_strict(child)
    return command


def _wrap_parser(make_parser: Callable[[click.Context], Any]) -> Any:
    def make_checked(ctx: click.Context) -> Any:
        parser = make_parser(ctx)
        parse: Parse = parser.parse_args

        def parse_checked(args: list[str]) -> tuple[dict[str, Any], list[str], list[click.Parameter]]:
            found = parse(args)
            _check_repetition(found[2], ctx)
            return found

        parser.parse_args = parse_checked
        return parser

    return make_checked


def _check_repetition(order: Sequence[click.Parameter], ctx: click.Context) -> None:
    """Raise click.UsageError for an option of one value that is given more than once."""
    seen: set[str] = set()
    for param in order:
        if not isinstance(param, click.Option) or param.multiple or param.count or param.is_flag:
            continue
        name = max(param.opts, key=len)
        if name in seen:
            raise click.UsageError(f"{name}: expected at most once, found it again", ctx)
        seen.add(name)
