"""The application: what it is made of, and the routes."""

from asyncio import create_task
from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager

from fastapi import APIRouter, FastAPI
from starlette.concurrency import run_in_threadpool

from mdrive_sumo import __version__
from server import clock
from server.api import problems
from server.api.database_reader import DirectDatabaseReader, SubprocessDatabaseReader
from server.api.dependencies import Services
from server.api.leaderboard_cache import LeaderboardCache
from server.api.openapi import make_openapi
from server.api.request_bodies import RequestBodyMiddleware
from server.api.response_headers import ResponseHeadersMiddleware
from server.api.routes import events, health, leaderboards, phases, register, results, submissions, submit, teams
from server.api.subprocess_runner import CallRunner, SubprocessRunner
from server.api.upload import Uploads
from server.archive import ArchiveLimits
from server.phase_suites import LoadedPhaseSuites, PhaseSuites
from server.settings import ServerSettings
from server.store import Store
from server.store.phases import list_phases as every_phase
from server.store.phases import set_phases as put_phases

API = "/api/v1"
UPLOADS = (f"{API}/submissions", "/submit")
"""Where archives are sent to: the second is the pages' form."""
START_S = 60.0
MAX_CHECKS, MAX_REPLAYS = 20, 12
"""Archives that are checked and replay pages that are made at a time, all but one of each waiting for their turn: every
one holds a thread, and there are 40 for all requests."""
_ABOUT = """
Send an agent, watch it drive, see it ranked. Everything that goes wrong is answered as problem details (RFC 9457):
`detail` is one sentence that says what to do about it. Tokens are sent as `Authorization: Bearer TOKEN`.
"""


def create_app(
    settings: ServerSettings,
    store: Store | None = None,
    suites: PhaseSuites | None = None,
    aside: CallRunner | None = None,
    now: Callable[[], int] = clock.now_us,
) -> FastAPI:
    """The API. What is not given is opened here; tests give their own. Pages are mounted on it by `server.web`.

    `app.state.tools` has the settings, the store and the rest, `app.state.now` the clock. Raises InputError.
    """
    reader = DirectDatabaseReader(store) if store is not None else SubprocessDatabaseReader(settings.database_url)
    store = store if store is not None else Store(settings.database_url)
    tools = Services(
        settings,
        store,
        suites if suites is not None else LoadedPhaseSuites(settings),
        aside if aside is not None else SubprocessRunner(MAX_CHECKS),
        aside if aside is not None else SubprocessRunner(MAX_REPLAYS),
        LeaderboardCache(reader),
        Uploads(),
    )

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncGenerator[None]:  # noqa: ARG001 (FastAPI's signature)
        await run_in_threadpool(prepare_storage, tools, now())
        await tools.boards.make_all(now)
        await run_in_threadpool(tools.aside.call, START_S, ArchiveLimits)  # so that the first upload waits for nothing
        keeper = create_task(tools.boards.keep(now))
        yield
        keeper.cancel()
        await run_in_threadpool(tools.boards.close)
        for each in (tools.aside, tools.painter):
            await run_in_threadpool(each.close)

    app = FastAPI(
        title="mdrive-sumo challenge",
        version=__version__,
        description=_ABOUT,
        lifespan=lifespan,
        openapi_url=f"{API}/openapi.json",
        docs_url=None,  # they load their scripts from other hosts
        redoc_url=None,
    )
    app.state.tools, app.state.now = tools, now
    problems.install_handlers(app)
    app.add_middleware(RequestBodyMiddleware, uploads=UPLOADS, most=settings.limits.archive_bytes)
    app.add_middleware(ResponseHeadersMiddleware)
    app.include_router(_make_router(), prefix=API)
    app.openapi = make_openapi(app)
    return app


def prepare_storage(tools: Services, now_us: int) -> None:
    """Folders, tables, phases and the suites of all that are not over, as the settings say. Raises InputError."""
    tools.settings.archives.mkdir(parents=True, exist_ok=True)
    tools.settings.recordings.mkdir(parents=True, exist_ok=True)
    tools.store.migrate()
    with tools.store.write() as session:
        put_phases(session, [phase.as_new() for phase in tools.settings.phases], now_us)
    with tools.store.read() as session:
        wanted = [phase for phase in every_phase(session) if now_us < phase.closes_us]
    for phase in wanted:
        tools.suites.jobs(phase)


def _make_router() -> APIRouter:
    router = APIRouter()
    for part in (teams, register, phases, submit, submissions, results, events, leaderboards, health):
        router.include_router(part.router)
    return router
