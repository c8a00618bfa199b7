"""Shared by `serve` and `admin`: options, settings, and errors of the database."""

from collections.abc import Generator
from contextlib import contextmanager
from json import JSONDecodeError
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
    "--data", type=click.Path(path_type=Path, file_okay=False), metavar="DIR", help="Data folder."
)


def load_settings_with(file: Path | None, data: Path | None, **options: object) -> ServerSettings:
    """Load the settings of `file`, overridden by command-line options. Raises InputError."""
    settings = load_settings(file)
    given = {name: value for name, value in {"data": data, **options}.items() if value is not None}
    return settings.model_copy(update=given)


@contextmanager
def report_store_errors() -> Generator[None]:
    """Raise InputError for StoreUnavailable: the user can start the database. Also for values that are damaged."""
    try:
        yield
    except StoreUnavailable as error:
        raise InputError(str(error)) from None
    except (JSONDecodeError, UnicodeDecodeError) as error:
        reason = " ".join(str(error).split())
        raise InputError(
            f"database: expected values as this version writes them, found damaged ones: {reason}"
        ) from None
