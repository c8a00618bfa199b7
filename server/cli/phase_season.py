"""`mdrive-sumo admin phase draw`: a hidden phase gets a season that needs its secret."""

import secrets
from pathlib import Path
from typing import Protocol

import click

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_text
from mdrive_sumo.core.output_files import make_folder, write_bytes
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.scenario.season import BENCHMARK_SUITES
from mdrive_sumo.scenario.suite import Suite
from server.settings import PhaseSettings, ServerSettings

*BUCKETS, WHOLE = BENCHMARK_SUITES
SECRETS_FOLDER = "seasons"
"""In the data folder: the secrets of seasons, one file a phase."""
SECRET_BYTES = 32
LEAST_SECRET = 16
"""Least length of a secret [characters], as of `generate --season`."""


class _HasSettings(Protocol):
    """The context of `mdrive-sumo admin`."""

    settings: ServerSettings


class _EchoedProgress:
    """Prints a line for each candidate on standard error."""

    def note(self, text: str) -> None:
        """See SeasonProgress."""
        echo(text, err=True)


def draw_phase_season(settings: ServerSettings, phase: str, workers: int, per_group: int | None = None) -> Suite:
    """Draw the season of a hidden phase into the folder that its settings name, and return the phase's suite.

    The secret is made in the data folder unless it is there. per_group: for tests, see `SeasonRequest`. Raises
    InputError.
    """
    # Imported here: the other commands of `admin` start without the generator.
    from mdrive_sumo.generate.seasons.draw_season import SeasonRequest, draw_season
    from mdrive_sumo.generate.seasons.season_seed import parse_season

    found = _find_phase(settings, phase)
    folder = Path(found.suite)
    buckets = BUCKETS if folder.name == WHOLE else (folder.name,)
    seed = parse_season(phase, _read_secret(settings.data / SECRETS_FOLDER / phase))
    request = SeasonRequest(seed, folder.parent, buckets, workers, per_group)
    suites = draw_season(request, _EchoedProgress())
    return next(suite for suite in suites if suite.folder == folder)


def _find_phase(settings: ServerSettings, name: str) -> PhaseSettings:
    """Return a hidden phase whose suite is the folder of a season. Raises InputError."""
    found = next((phase for phase in settings.phases if phase.id == name), None)
    if found is None:
        known = ", ".join(phase.id for phase in settings.phases) or "none; give --settings"
        raise InputError(f"phase draw: expected a phase of the settings ({known}), found {name!r:.60}")
    folder = Path(found.suite)
    if found.public:
        raise InputError(f"phase draw: expected a hidden phase, found {name}, which is public: set public = false")
    if not folder.is_absolute() or folder.name not in BENCHMARK_SUITES:
        raise InputError(
            f"phase draw: phase {name}: suite: expected an absolute folder FOLDER/{WHOLE} or FOLDER/BUCKET for the"
            f" season, found {found.suite!r:.80}"
        )
    if folder.exists():
        raise InputError(f"phase draw: phase {name}: expected no folder {folder} yet, found one: its season is drawn")
    return found


def _read_secret(path: Path) -> str:
    """Return the secret of a phase, which is made if there is none. Raises InputError."""
    try:
        if not path.exists():
            make_folder(path.parent, mode=0o700)
            write_bytes(path, secrets.token_urlsafe(SECRET_BYTES).encode() + b"\n", mode=0o600)
        secret = read_text(path).strip()
    except OSError as error:
        raise InputError(f"{path}: cannot be read or written: {error.strerror}") from None
    if len(secret) < LEAST_SECRET:
        raise InputError(f"{path}: expected a secret of {LEAST_SECRET} characters or more, found {len(secret)}")
    return secret


def describe_drawn(suite: Suite, secret: Path) -> str:
    """Return what an operator is told about a season that was drawn."""
    return (
        f"{suite.label}, {len(suite)} scenarios, {suite.checksum()}: {suite.folder}\nsecret: {secret}; keep a copy,"
        " the season can be drawn again from it by this version only\n`mdrive-sumo admin phase apply` or the next start"
        " of the server opens the phase"
    )


@click.command("draw")
@click.argument("phase")
@click.option("--workers", type=click.IntRange(1), default=1, show_default=True, help="Processes that draw.")
@click.option("--per-category", "per_group", type=click.IntRange(1), hidden=True)
@click.pass_obj
def draw_phase(admin_context: _HasSettings, phase: str, workers: int, per_group: int | None) -> None:
    """Draw a secret season for a hidden phase, into the folder that its settings name as its suite.

    The same command continues after Ctrl-C. The secret is made in the data folder.
    """
    settings = admin_context.settings
    suite = draw_phase_season(settings, phase, workers, per_group)
    echo(describe_drawn(suite, settings.data / SECRETS_FOLDER / phase))
