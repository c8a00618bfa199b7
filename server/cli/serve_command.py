"""`mdrive-sumo serve`: the API, the pages, and the workers, until somebody ends it."""

import asyncio
import fcntl
import os
import signal
import socket
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

import click
import h11
import uvicorn
from fastapi import FastAPI
from uvicorn.protocols.http.h11_impl import H11Protocol

from mdrive_sumo.core.errors import InputError
from server import environments, web
from server.api import create_app
from server.api.app import prepare_storage
from server.api.upload import UPLOAD_S
from server.cli.options import data_option, load_settings_with, report_store_errors, settings_option
from server.clock import now_us
from server.evaluation.supervisor import Supervisor
from server.settings import WARM_UP, ServerSettings
from server.store import Store, phases

GRACE_S = 5
"""For answers under way when the server ends; streams of events are cut, and clients come back."""
HEADER_BYTES = 32 * 1024
"""Of one request, all headers together."""
REQUEST_S = 20.0
"""From the connection, or the last answer, to the end of the next request's headers."""
BACKLOG = 2048
LOCK_FILE = "serve.lock"
EXECUTORS = ("local", "dask")
"""As of `eval`, whose module would bring the simulator along."""


@click.command("serve")
@settings_option
@data_option
@click.option("--host", help="Address to listen on [default: 127.0.0.1].")
@click.option("--port", type=click.IntRange(0, 65535), help="[default: 8000]")
@click.option(
    "--executor",
    type=click.Choice(EXECUTORS),
    help="Who works: processes here, or the workers of a Dask cluster [default: as the settings say, else local].",
)
@click.option("--scheduler", default="", metavar="tcp://HOST:PORT", help="Of the Dask cluster.")
def serve(
    file: Path | None, data: Path | None, host: str | None, port: int | None, executor: str | None, scheduler: str
) -> None:
    """Serve a challenge: the HTTP API, the pages, and the workers that drive.

    Without settings there is one phase, warm-up, on the packaged suite interdrive.

    Ctrl-C or SIGTERM ends it: running jobs go back to the queue.
    """
    settings = _apply_executor(load_settings_with(file, data, host=host, port=port), executor, scheduler)
    signal.signal(signal.SIGTERM, _exit_on_signal)
    with report_store_errors(), _lock_data_folder(settings), _open_listener(settings) as listener:
        settings = _apply_phases(settings, file)
        _print_missing_environments(settings)
        app = make_app(settings)
        tools = app.state.tools
        prepare_storage(tools, now_us())
        supervisor = Supervisor(tools.store, settings)
        supervisor.start()
        try:
            _run(app, settings, listener)
        finally:
            supervisor.stop()


def make_app(settings: ServerSettings) -> FastAPI:
    """The API and the pages."""
    app = create_app(settings)
    web.mount(app)
    return app


def _run(app: FastAPI, settings: ServerSettings, listener: socket.socket) -> None:
    config = uvicorn.Config(
        app,
        host=settings.host,
        port=settings.port,
        http=TimeoutProtocol,
        timeout_graceful_shutdown=GRACE_S,
        h11_max_incomplete_event_size=HEADER_BYTES,
        server_header=False,
    )
    server = _Server(config)
    try:
        server.run(sockets=[listener])
    except KeyboardInterrupt:
        click.echo("ended; running jobs go back to the queue", err=True)
    if not server.started:
        raise InputError("serve: the server did not start; the lines above say why")


class TimeoutProtocol(H11Protocol):
    """Closes a connection on which no request arrives: uvicorn waits for the first, and for one begun, for ever."""

    _timer: asyncio.TimerHandle

    def connection_made(self, transport: asyncio.Transport) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Of asyncio."""
        super().connection_made(transport)
        self._timer = self.loop.call_later(REQUEST_S, self._look, self.cycle)

    def on_response_complete(self) -> None:
        """Of uvicorn."""
        answered = self.cycle
        super().on_response_complete()  # it may begin with the next one
        self._timer.cancel()
        # Answered before all of its body came: the rest is thrown away, for most clients read no answer before that.
        left_s = UPLOAD_S if self.conn.their_state is h11.SEND_BODY else REQUEST_S
        self._timer = self.loop.call_later(left_s, self._look, answered)

    def _look(self, answered: object) -> None:
        if self.cycle is answered and not self.transport.is_closing():
            self.transport.close()


class _Server(uvicorn.Server):
    """Says where it is: uvicorn does not, of a socket that it is given."""

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Of uvicorn."""
        await super().startup(sockets)
        if self.started and sockets:
            host, port = self.config.host, sockets[0].getsockname()[1]
            place = f"[{host}]" if ":" in host else host
            click.echo(f"running on http://{place}:{port} (Ctrl-C ends it)", err=True)


@contextmanager
def _open_listener(settings: ServerSettings) -> Generator[socket.socket]:
    """Before anything else is begun, so that a port that is taken is the first thing said. Raises InputError."""
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


@contextmanager
def _lock_data_folder(settings: ServerSettings) -> Generator[None]:
    """Whoever serves a folder with a database of its own serves it alone. Raises InputError."""
    try:
        settings.data.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"serve: {settings.data}: cannot be made: {error.strerror}; choose another --data") from None
    if settings.database:  # several machines may then share the folder
        yield
        return
    with (settings.data / LOCK_FILE).open("a+") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            file.seek(0)
            whose = file.read().strip() or "?"
            sentence = f"serve: {settings.data} is being served by process {whose}; end it, or choose another --data"
            raise InputError(sentence) from None
        file.truncate(0)
        file.write(f"{os.getpid()}\n")
        file.flush()
        yield


def _apply_executor(settings: ServerSettings, executor: str | None, scheduler: str) -> ServerSettings:
    """What the command line says over `work.scheduler`. Raises InputError."""
    if executor is None and not scheduler:
        return settings
    scheduler = scheduler or (settings.work.scheduler if executor == "dask" else "")
    if (executor == "dask") != bool(scheduler):
        raise InputError(f"--executor {executor or EXECUTORS[0]}: expected --scheduler with dask and only then")
    return settings.model_copy(update={"work": settings.work.model_copy(update={"scheduler": scheduler})})


def _apply_phases(settings: ServerSettings, file: Path | None) -> ServerSettings:
    """Where nobody said which phases there are: those of the database, or else one to begin with."""
    if file is not None or settings.phases:
        if not settings.phases:
            click.echo(f"note: {file} names no phases, so nothing can be submitted (docs/server.md)", err=True)
        return settings
    store = Store(settings.database_url)
    try:
        store.migrate()
        with store.read() as session:
            known = ", ".join(phase.id for phase in phases.list_phases(session) if phase.id != WARM_UP.id)
    finally:
        store.close()
    if known:
        click.echo(f"note: no settings file; phases are those of the database: {known}", err=True)
        return settings
    sentence = f"no settings file, so there is one phase, {WARM_UP.id}, on the public suite {WARM_UP.suite}"
    click.echo(f"note: {sentence} (docs/server.md)", err=True)
    return settings.model_copy(update={"phases": (WARM_UP,)})


def _print_missing_environments(settings: ServerSettings) -> None:
    if not environments.list_built(settings.environments):
        name = next(iter(environments.RECIPES))
        command = f"mdrive-sumo admin --data {settings.data} environment build {name}"
        click.echo(f"note: no environment is built, so every agent is refused; build one: {command}", err=True)


def _exit_on_signal(number: int, frame: object) -> NoReturn:  # noqa: ARG001 (the signature of signal handlers)
    """uvicorn raises the signal again when it is done, and then the workers are still to be stopped."""
    raise SystemExit(0)
