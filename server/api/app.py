"""The ASGI application of the API: its services, middleware, routes and OpenAPI description."""

import json
from asyncio import create_task
from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager
from typing import Any

from fastapi import APIRouter, FastAPI
from fastapi.openapi.utils import get_openapi
from starlette.concurrency import run_in_threadpool

from mdrive_sumo import __version__
from mdrive_sumo.core.output_files import make_folder
from server import clock
from server.api import problems
from server.api.concurrency_limit import ConcurrencyLimit
from server.api.dependencies import CHECKERS, OPTIONAL_TOKEN, Services
from server.api.leaderboard_cache import DirectDatabaseReader, LeaderboardCache, SubprocessDatabaseReader
from server.api.problems import Problem
from server.api.request_bodies import RequestBodyMiddleware
from server.api.response_cache import ResponseCacheMiddleware
from server.api.response_headers import ResponseHeadersMiddleware
from server.api.routes import (
    events,
    health,
    leaderboards,
    overviews,
    phases,
    results,
    submissions,
    teams,
    webhook,
)
from server.api.subprocess_runner import CallRunner, SubprocessPool, SubprocessRunner
from server.phase_suites import LoadedPhaseSuites, PhaseSuites
from server.settings import ServerSettings
from server.store import Store, standings
from server.store.phases import list_phases as every_phase
from server.store.phases import set_phases as put_phases

API = "/api/v1"
ROUTERS = (
    *(teams.router, webhook.router, teams.registration_router, phases.router, submissions.router, results.router),
    *(overviews.router, events.router, leaderboards.router, health.router),
)
"""In the order of the description."""
UPLOADS = (f"{API}/submissions", "/submit")
"""Paths that receive archives: the API's and that of the web form."""
CHECKER_NICE = 2
"""Niceness of the checkers: requests have priority."""
MAX_REPLAYS = 12
"""Replay pages under way at a time, waiting ones included: each holds one of the 40 threads that serve all requests."""
_RENAMED = {"ChallengeTrack": "Track", "SubmissionState": "State", "TokenScope": "Scope"}
"""OpenAPI: published names of components whose classes have more telling ones."""
_ABOUT = """
Submit an agent, follow its evaluation, see its rank. Errors are problem details (RFC 9457): `detail` is one sentence
that says what to do. Send tokens as `Authorization: Bearer TOKEN`.
"""


def create_app(
    settings: ServerSettings,
    store: Store | None = None,
    suites: PhaseSuites | None = None,
    runner: CallRunner | None = None,
    now: Callable[[], int] = clock.now_us,
) -> FastAPI:
    """Return the API application; `server.web` mounts the pages on it.

    Services that are not given are created from the settings. `app.state.services` holds them, `app.state.now` the
    clock [us since 1970]. Raises InputError.
    """
    app = FastAPI(
        title="mdrive-sumo challenge",
        version=__version__,
        description=_ABOUT,
        lifespan=_lifespan,
        openapi_url=f"{API}/openapi.json",
        docs_url=None,  # FastAPI's documentation pages load scripts from other hosts
        redoc_url=None,
    )
    install_services(app, _make_services(settings, store, suites, runner), now)
    problems.install_handlers(app)
    app.include_router(_make_router(), prefix=API)
    app.openapi = make_openapi(app)
    return app


def _make_services(
    settings: ServerSettings, store: Store | None, suites: PhaseSuites | None, runner: CallRunner | None
) -> Services:
    """Return what was given, and the rest as the settings want it. Raises InputError."""
    connections = settings.connections
    reader = DirectDatabaseReader(store) if store is not None else SubprocessDatabaseReader(settings.database_url)
    return Services(
        settings,
        store if store is not None else Store(settings.database_url),
        suites if suites is not None else LoadedPhaseSuites(settings),
        runner if runner is not None else SubprocessPool(CHECKERS, CHECKER_NICE),
        runner if runner is not None else SubprocessRunner(MAX_REPLAYS),
        LeaderboardCache(reader),
        ConcurrencyLimit("upload", connections.uploads_per_team, connections.uploads),
        ConcurrencyLimit("stream of events", connections.streams_per_team, connections.streams),
    )


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncGenerator[None]:
    services, now = app.state.services, app.state.now
    await run_in_threadpool(prepare_storage, services, now())
    await services.leaderboards.refresh_all(now)
    await run_in_threadpool(app.openapi)  # it takes a moment, in which a first request would occupy the event loop
    if isinstance(services.check_runner, SubprocessPool):  # before the first upload needs it
        await run_in_threadpool(services.check_runner.start)
    refresher = create_task(services.leaderboards.refresh_forever(now))
    yield
    refresher.cancel()
    await run_in_threadpool(services.leaderboards.close)
    await run_in_threadpool(services.check_runner.close)
    await run_in_threadpool(services.replay_runner.close)


def install_services(app: FastAPI, services: Services, now: Callable[[], int]) -> None:
    """Give the application its services, its clock and the layers around the routes, the innermost first.

    An application that had others forgets them; its routes stay.
    """
    app.state.services, app.state.now = services, now
    app.user_middleware.clear()
    app.middleware_stack = None
    max_upload, boards = services.settings.limits.archive_bytes, services.leaderboards
    app.add_middleware(RequestBodyMiddleware, uploads=UPLOADS, max_upload=max_upload)
    app.add_middleware(ResponseHeadersMiddleware)
    app.add_middleware(ResponseCacheMiddleware, is_cached_path=_is_board, now=now, generation=lambda: boards.generation)


def _is_board(path: str) -> bool:
    """Return whether a path is that of a leaderboard: the page, the API or the CSV, but no team's history."""
    is_of_api = path.startswith(f"{API}/leaderboards/") and "/teams/" not in path
    return path in ("/", "/leaderboard.csv") or is_of_api


def prepare_storage(services: Services, now_us: int) -> None:
    """Create folders and tables, write the phases of the settings, load the suites of unfinished phases.

    Raises InputError.
    """
    make_folder(services.settings.archives, may_be_link=True)
    make_folder(services.settings.recordings, may_be_link=True)
    services.store.migrate()
    with services.store.write() as session:
        put_phases(session, [phase.as_new() for phase in services.settings.phases], now_us)
        standings.refresh_scores(session)
    with services.store.read() as session:
        unfinished = [phase for phase in every_phase(session) if now_us < phase.closes_us]
    for phase in unfinished:
        services.suites.jobs(phase)


def _make_router() -> APIRouter:
    router = APIRouter()
    for part in ROUTERS:
        router.include_router(part)
    return router


def make_openapi(app: FastAPI) -> Callable[[], dict[str, Any]]:
    """Return a function for `app.openapi` that builds the description on its first call."""

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            description = get_openapi(
                title=app.title, version=app.version, description=app.description, routes=app.routes
            )
            problem = Problem.model_json_schema(ref_template="#/components/schemas/{model}")
            description.setdefault("components", {}).setdefault("schemas", {})["Problem"] = problem
            app.openapi_schema = _use_published_names(_describe_tokens(description))
        return app.openapi_schema

    return openapi


def _describe_tokens(description: dict[str, Any]) -> dict[str, Any]:
    """Return the description with one scheme; where the token is optional, an empty requirement stands before it.

    OpenAPI 3.1, "Security Requirement Object": "To make security optional, an empty security requirement ({}) can be
    included in the array."
    """
    schemes: dict[str, Any] = description["components"]["securitySchemes"]
    schemes.pop(OPTIONAL_TOKEN)
    (required,) = ({name: []} for name in schemes)
    for methods in description["paths"].values():
        for operation in methods.values():
            if "security" in operation:
                is_required = required in operation["security"]
                operation["security"] = [required] if is_required else [{}, required]
    return description


def _use_published_names(description: dict[str, Any]) -> dict[str, Any]:
    """Return the description with the component names that clients know: without the suffixes `In` and `Out`."""
    components: dict[str, Any] = description["components"]["schemas"]
    published = {name: _RENAMED.get(name, name.removesuffix("Out").removesuffix("In")) for name in components}
    for name, schema in components.items():
        if schema.get("title") == name:
            schema["title"] = published[name]
    description["components"]["schemas"] = {published[name]: schema for name, schema in components.items()}
    text = json.dumps(description)
    for name, new in published.items():
        text = text.replace(f'"#/components/schemas/{name}"', f'"#/components/schemas/{new}"')
    return json.loads(text)
