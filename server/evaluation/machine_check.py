"""Checks whether this machine may run agents; for workers and for the server."""

from collections.abc import Iterator
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

from sqlalchemy import make_url
from sqlalchemy.orm import Session

from mdrive_sumo.agent_process import sandbox
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.make_executor import check_scheduler_address
from mdrive_sumo.scenario.packaged_suites import find_packaged_suite
from mdrive_sumo.scenario.season import read_stored_name
from server import environments
from server.settings import ServerSettings
from server.store import phases

SHARED_KERNEL_SETTING = "[sandbox] hidden_on_shared_kernel = true"
_ADVICE = (
    "Install what is missing (docs/sandbox-backends.md), or require less with MDRIVE_SANDBOX__REQUIRED=LAYER,LAYER,..."
)


def check_machine(settings: ServerSettings) -> None:
    """Raise InputError if sandboxes lack required layers, would see secrets, or the cluster cannot be reached.

    On a cluster agents run elsewhere: there each job checks the layers.
    """
    _check_secrets(settings)
    if settings.work.scheduler:
        check_scheduler_address(settings.work.scheduler)
    else:
        try:
            wanted = settings.sandbox
            sandbox.check_layers(wanted.required, wanted.choose_backend(), wanted.copies)
        except InputError as error:
            raise InputError(f"{error}. {_ADVICE}") from None


@lru_cache(maxsize=1)
def find_layers(required: tuple[str, ...], backend: str, copies: Path) -> tuple[str, ...]:
    """Return the sandbox layers of this machine, examined once a process. Raises InputError if a required one lacks."""
    return sandbox.check_layers(required, backend, copies)


def check_hidden_phases(settings: ServerSettings, session: Session, now_us: int) -> None:
    """Raise InputError if this machine would run hidden phases that are not over in boxes that share its kernel.

    On a cluster agents run elsewhere: there each job checks it.
    """
    work = settings.work
    hidden = (phase for phase in phases.list_phases(session) if not phase.public and phase.closes_us > now_us)
    if work.scheduler or work.phase_kinds == "public" or not any(hidden):
        return
    may_share = settings.sandbox.hidden_on_shared_kernel
    sandbox.check_shared_kernel(settings.sandbox.choose_backend(), may_share=may_share, setting=SHARED_KERNEL_SETTING)


def _check_secrets(settings: ServerSettings) -> None:
    """Sandboxes see some folders of the host, e.g. /usr: database and hidden scenarios must be elsewhere."""
    visible = frozenset(_list_visible_paths(settings))
    for name, path in _list_secret_paths(settings):
        for folder in {path.resolve(), *path.resolve().parents} & visible:
            raise InputError(
                f"{name}: expected a folder that no sandbox sees, found {path}: every agent can read {folder}"
            )


def _list_secret_paths(settings: ServerSettings) -> Iterator[tuple[str, Path]]:
    yield "data", settings.data
    url = make_url(settings.database_url)
    if url.get_backend_name() == "sqlite" and url.database:
        yield "database", Path(url.database)
    for phase in settings.phases:
        if not phase.public and find_packaged_suite(read_stored_name(phase.suite)) is None:
            yield f"phase {phase.id}: suite", Path(phase.suite)


def _list_visible_paths(settings: ServerSettings) -> Iterator[Path]:
    yield from sandbox.list_shown_paths()
    for name in environments.list_built(settings.environments):
        with suppress(InputError):  # an unreadable one is reported by the job that uses it
            made = environments.load_environment(name, settings.environments)
            if made.rootfs is not None:
                yield from sandbox.list_shown_paths(made.rootfs)
            else:
                yield from (made.python.resolve().parent.parent, *([made.site.resolve()] if made.site else ()))
