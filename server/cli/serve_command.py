"""`mdrive-sumo serve`: API, web pages and workers."""

import copy
import signal
import socket
import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

import click
import uvicorn
from fastapi import FastAPI
from uvicorn.config import LOGGING_CONFIG

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.posix import check_posix
from mdrive_sumo.core.terminal import CleanFormatter, echo
from server import environments
from server.api.app import create_app, prepare_storage
from server.api.webhook_sender import WebhookSender
from server.cli.data_folder import lock_data_folder
from server.cli.limited_protocol import (
    ACCEPTED_AT_ONCE,
    HEADER_BYTES,
    limit_connections,
    limit_listener,
    raise_open_files,
)
from server.cli.options import data_option, load_settings_with, report_store_errors, settings_option
from server.clock import now_us
from server.evaluation.supervisor import Supervisor
from server.settings import WARM_UP, ServerSettings
from server.store import Store, phases
from server.web.mount_pages import mount_pages

GRACE_S = 5
"""Time for open responses when the server stops [s]; event streams are closed, and clients reconnect."""
SWITCH_S = 0.001
"""Time after which a busy thread lets another one run [s]; Python's 5 ms delay the event loop often."""
BACKLOG = 4096
"""Connections that wait in the kernel to be accepted, and as many that have said nothing yet."""
EXECUTORS = ("local", "dask")
"""Executors as in `eval`, whose module would import the simulator."""


@click.command("serve")
@settings_option
@data_option
@click.option("--host", help="Address to listen on [default: 127.0.0.1].")
@click.option("--port", type=click.IntRange(0, 65535), help="[default: 8000]")
@click.option(
    "--executor",
    type=click.Choice(EXECUTORS),
    help="Run jobs in local processes or on a Dask cluster [default: as in the settings, else local].",
)
@click.option("--scheduler", default="", metavar="tcp://HOST:PORT", help="Address of the Dask cluster.")
def serve(
    file: Path | None, data: Path | None, host: str | None, port: int | None, executor: str | None, scheduler: str
) -> None:
    """Serve a challenge: the HTTP API, the web pages, and the workers.

    Without settings there is one phase, warm-up, on the packaged suite interdrive.

    Ctrl-C or SIGTERM stops it: running jobs return to the queue.
    """
    check_posix("serve: the server")
    settings = _apply_executor(load_settings_with(file, data, host=host, port=port), executor, scheduler)
    signal.signal(signal.SIGTERM, _exit_on_signal)
    with report_store_errors(), lock_data_folder(settings), _open_listener(settings) as listener:
        _check_database(settings)
        settings = _apply_phases(settings, file)
        _print_missing_environments(settings)
        app = make_app(settings)
        services = app.state.services
        prepare_storage(services, now_us())
        supervisor = Supervisor(services.store, settings)
        supervisor.start()
        try:
            with _send_webhooks(services.store, settings):
                _run(app, settings, listener)
        finally:
            supervisor.stop()


@contextmanager
def _send_webhooks(store: Store, settings: ServerSettings) -> Generator[None]:
    sender = WebhookSender(store, settings.webhooks)
    if not settings.webhooks.enabled:
        yield
        return
    sender.start()
    try:
        yield
    finally:
        sender.stop()


def make_app(settings: ServerSettings) -> FastAPI:
    """Return the application with API and pages."""
    app = create_app(settings)
    mount_pages(app)
    return app


def build_log_config() -> dict[str, Any]:
    """Return uvicorn's settings of logs, in whose lines nothing that a client wrote is acted on by a terminal."""
    config = copy.deepcopy(LOGGING_CONFIG)
    config["formatters"] = {
        "default": {"()": CleanFormatter, "fmt": "%(levelname)s:     %(message)s"},
        "access": {"()": CleanFormatter, "fmt": "%(levelname)s:     %(message)s"},
    }
    config["loggers"]["mdrive"] = {"handlers": ["default"], "level": "WARNING", "propagate": False}
    return config


def _run(app: FastAPI, settings: ServerSettings, listener: socket.socket) -> None:
    protocol = limit_connections(settings.connections.total, settings.connections.per_address)
    config = uvicorn.Config(
        app,
        host=settings.host,
        port=settings.port,
        loop="asyncio",  # uvloop, which uvicorn takes where it is installed, does not call `LimitedListener.accept`
        http=protocol,
        ws="none",  # a connection that changes to WebSocket would leave the protocol that counts it
        backlog=ACCEPTED_AT_ONCE,
        timeout_graceful_shutdown=GRACE_S,
        h11_max_incomplete_event_size=HEADER_BYTES,
        server_header=False,
        log_config=build_log_config(),
    )
    sys.setswitchinterval(SWITCH_S)
    if (most := raise_open_files(settings.connections.total)) < settings.connections.total:
        echo(f"note: connections.total: this process may open too few files; about {most} are possible", err=True)
    server = _Server(config)
    try:
        with limit_listener(listener, protocol) as limited:
            server.run(sockets=[limited])
    except KeyboardInterrupt:
        echo("stopped; running jobs return to the queue", err=True)
    if not server.started:
        raise InputError("serve: the server did not start; the lines above say why")


class _Server(uvicorn.Server):
    """Prints its address, which uvicorn does not for a socket that it is given; sets the length of the kernel's queue.

    asyncio takes one number for this length and for how many connections it accepts before it does other work.
    """

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """uvicorn's callback."""
        await super().startup(sockets)
        if self.started and sockets:
            sockets[0].listen(BACKLOG)
            host, port = self.config.host, sockets[0].getsockname()[1]
            address = f"[{host}]" if ":" in host else host
            echo(f"running on http://{address}:{port} (Ctrl-C stops it)", err=True)


@contextmanager
def _open_listener(settings: ServerSettings) -> Generator[socket.socket]:
    """Open the listening socket before anything else, so that an occupied port is reported first. Raises InputError."""
    host, port = settings.host, settings.port
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0][0]
        listener = socket.create_server((host, port), family=family, backlog=BACKLOG)
    except OSError as error:
        raise InputError(
            f"serve: cannot listen on {host} port {port}: {error.strerror}; choose another --port"
        ) from None
    with listener:
        yield listener


def _apply_executor(settings: ServerSettings, executor: str | None, scheduler: str) -> ServerSettings:
    """Override `work.scheduler` with the command line. Raises InputError."""
    if executor is None and not scheduler:
        return settings
    scheduler = scheduler or (settings.work.scheduler if executor == "dask" else "")
    if (executor == "dask") != bool(scheduler):
        raise InputError(f"--executor {executor or EXECUTORS[0]}: expected --scheduler with dask and only then")
    return settings.model_copy(update={"work": settings.work.model_copy(update={"scheduler": scheduler})})


def _check_database(settings: ServerSettings) -> None:
    """Read a SQLite file once from end to end. Raises InputError if it is damaged."""
    store = Store(settings.database_url)
    store.check(whole=True)
    store.close()


def _apply_phases(settings: ServerSettings, file: Path | None) -> ServerSettings:
    """Without phases in the settings, use those of the database, else the warm-up phase."""
    if file is not None or settings.phases:
        if not settings.phases:
            echo(f"note: {file} defines no phases, so nothing can be submitted (docs/server.md)", err=True)
        return settings
    store = Store(settings.database_url)
    try:
        store.migrate()
        with store.read() as session:
            listed = ", ".join(phase.id for phase in phases.list_phases(session) if phase.id != WARM_UP.id)
    finally:
        store.close()
    if listed:
        echo(f"note: no settings file; using the phases of the database: {listed}", err=True)
        return settings
    sentence = f"no settings file; using one phase, {WARM_UP.id}, on the public suite {WARM_UP.suite}"
    echo(f"note: {sentence} (docs/server.md)", err=True)
    return settings.model_copy(update={"phases": (WARM_UP,)})


def _print_missing_environments(settings: ServerSettings) -> None:
    if not environments.list_built(settings.environments):
        name = next(iter(environments.RECIPES))
        command = f"mdrive-sumo admin --data {settings.data} environment build {name}"
        echo(f"note: no environment is built, so every agent is refused; build one with: {command}", err=True)


def _exit_on_signal(number: int, frame: object) -> NoReturn:  # noqa: ARG001 (the signature of signal handlers)
    """Exit normally: uvicorn raises the signal again at its end, when the workers must still be stopped."""
    raise SystemExit(0)
