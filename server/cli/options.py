"""What `serve` and `admin` have in common: how they find the settings, and what they say of a database that is away."""

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import click

from mdrive_sumo.core.errors import InputError
from server.settings import ServerSettings, load_settings
from server.store import StoreUnavailable

settings_option = click.option(
    "--settings",
    "file",
    envvar="MDRIVE_SETTINGS",
    type=click.Path(path_type=Path, dir_okay=False),
    help="TOML file (docs/server.md); also MDRIVE_SETTINGS.",
)
data_option = click.option(
    "--data", type=click.Path(path_type=Path, file_okay=False), metavar="DIR", help="Where everything is kept."
)


def load_settings_with(file: Path | None, data: Path | None, **more: object) -> ServerSettings:
    """The settings of `file`, with what the command line says over them. Raises InputError."""
    found = load_settings(file)
    given = {name: value for name, value in {"data": data, **more}.items() if value is not None}
    return found.model_copy(update=given)


@contextmanager
def report_store_errors() -> Generator[None]:
    """A database that does not answer is something that the user can mend: raises InputError for it."""
    try:
        yield
    except StoreUnavailable as error:
        raise InputError(str(error)) from None
