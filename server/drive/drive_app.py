"""The application of `mdrive-sumo drive`: pages, static files, scene, motion of takes, and the WebSocket."""

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from http import HTTPStatus
from typing import Annotated

from fastapi import Depends, FastAPI, Request, Response, WebSocket, WebSocketDisconnect
from fastapi.exceptions import RequestValidationError
from fastapi.responses import HTMLResponse
from jinja2 import Environment, PackageLoader, StrictUndefined
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Receive, Scope, Send

from mdrive_sumo.core.clean_text import clean_for_page
from mdrive_sumo.core.errors import InputError
from server.drive.access import HostCheck, Seat, SeatRole
from server.drive.browser_connection import NORMAL, POLICY_VIOLATION, BrowserConnection, Closing
from server.drive.drive_files import read_static_file, send_static_file
from server.drive.drive_host import DriveHost
from server.drive.drive_session import DriveSession
from server.drive.messages import format_problem
from server.drive.simulation_process import SimulationEnded

POLICY = "; ".join(
    (
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self' data: blob:",
        "font-src 'self'",
        "connect-src 'self'",
        "form-action 'none'",
        "base-uri 'none'",
        "frame-ancestors 'none'",
    )
)
"""No inline script, no inline style, nothing from other hosts."""
HEADERS = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}
"""Of every response. Links hold tokens, so no other site is told where a visitor comes from."""
MOTION_TRIES, MOTION_PAUSE_S = 5, 0.2
"""A second [s] in all: a take that ends is stored in a tenth of it."""
MAX_REASON_BYTES = 123
"""Of the reason for closing (RFC 6455, section 5.5: 125 bytes with the code)."""
NO_SEAT = "this link is not valid: links end with the server that printed them; ask for a new one"


class DriveRefusal(Exception):
    """A request that is answered with a status and one sentence."""

    def __init__(self, status: HTTPStatus, sentence: str) -> None:
        super().__init__(sentence)
        self.status = status
        self.sentence = sentence


_environment = Environment(
    loader=PackageLoader("server.drive"),
    autoescape=True,
    undefined=StrictUndefined,
    finalize=clean_for_page,
    trim_blocks=True,
    lstrip_blocks=True,
)


def create_drive_app(host: DriveHost) -> FastAPI:
    """Return the application. `app.state.host` holds the drives."""
    app = FastAPI(title="mdrive-sumo drive", openapi_url=None, docs_url=None, redoc_url=None)
    app.state.host = host
    app.add_middleware(HostCheckMiddleware, hosts=host.hosts)
    app.middleware("http")(_add_headers)
    app.exception_handler(DriveRefusal)(_show_refusal)
    app.exception_handler(InputError)(_show_input_error)
    app.exception_handler(SimulationEnded)(_show_simulation_ended)
    app.exception_handler(HTTPException)(_show_http_error)
    app.exception_handler(RequestValidationError)(_show_validation_error)
    app.get("/")(show_links)
    app.get("/drive/{cav}")(show_driving_page)
    app.get("/watch")(show_watching_page)
    app.get("/scene")(send_scene)
    app.get("/takes/{number}/motion")(send_motion)
    app.get("/static/{name}")(send_file)
    app.websocket("/socket")(serve_socket)
    return app


class HostCheckMiddleware:
    """Refuses requests that name another host, before anything else sees them: DNS rebinding."""

    def __init__(self, app: ASGIApp, hosts: HostCheck) -> None:
        self._app = app
        self._hosts = hosts

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """ASGI."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = {key: value.decode("latin-1") for key, value in scope["headers"]}
        host, origin = headers.get(b"host"), headers.get(b"origin")
        is_allowed = self._hosts.is_host_allowed(host)
        if scope["type"] == "websocket":
            is_allowed = is_allowed and self._hosts.is_origin_allowed(origin, host)
            if not is_allowed:
                await send({"type": "websocket.close", "code": POLICY_VIOLATION})
                return
        elif not is_allowed:
            sentence = f"host: expected an address of this server, found {host!r:.80}; --public-url names another one"
            await _page("problem.html", HTTPStatus.MISDIRECTED_REQUEST, sentence=sentence)(scope, receive, send)
            return
        await self._app(scope, receive, send)


async def _add_headers(request: Request, call_next: Callable[[Request], Awaitable[Response]]) -> Response:
    response = await call_next(request)
    for name, value in HEADERS.items():
        response.headers.setdefault(name, value)
    return response


def _page(template: str, status: int, **context: object) -> HTMLResponse:
    text = _environment.get_template(template).render(**context)
    return HTMLResponse(text, status, headers=HEADERS | {"Cache-Control": "no-store"})


# ------------------------------------------------------------------------------------------------------------ refusals


async def _show_refusal(request: Request, error: DriveRefusal) -> Response:  # noqa: ARG001 (Starlette's signature)
    return _page("problem.html", error.status, sentence=error.sentence)


async def _show_input_error(request: Request, error: InputError) -> Response:  # noqa: ARG001
    return _page("problem.html", HTTPStatus.UNPROCESSABLE_ENTITY, sentence=str(error))


async def _show_simulation_ended(request: Request, error: SimulationEnded) -> Response:  # noqa: ARG001
    return _page("problem.html", HTTPStatus.SERVICE_UNAVAILABLE, sentence=str(error))


async def _show_http_error(request: Request, error: HTTPException) -> Response:
    sentence = f"there is nothing at {request.method} {request.url.path}"[:200]
    return _page("problem.html", error.status_code, sentence=sentence)


async def _show_validation_error(request: Request, error: RequestValidationError) -> Response:  # noqa: ARG001
    first = error.errors()[0]
    place = " ".join(str(part) for part in first["loc"])
    said = str(first["msg"]).removeprefix("Input should be ")
    sentence = f"{place}: expected {said[:1].lower()}{said[1:]}, found {first['input']!r:.60}"
    return _page("problem.html", HTTPStatus.UNPROCESSABLE_ENTITY, sentence=sentence)


# ------------------------------------------------------------------------------------------------------------ requests


def _get_host(request: Request) -> DriveHost:
    return request.app.state.host


HostDep = Annotated[DriveHost, Depends(_get_host)]


def require_seat(host: HostDep, token: str = "") -> Seat:
    """Return what the token of a link is for. Raises Refusal."""
    seat = host.tokens.find(token)
    if seat is None:
        sentence = NO_SEAT if token else "expected the whole link with its token, found an address without one"
        raise DriveRefusal(HTTPStatus.FORBIDDEN, sentence)
    return seat


SeatDep = Annotated[Seat, Depends(require_seat)]


def require_session(host: HostDep, seat: SeatDep) -> DriveSession:
    """Return the drive of a link. Raises Refusal."""
    session = host.find_session(seat.session)
    if session is None:
        raise DriveRefusal(
            HTTPStatus.NOT_FOUND, "expected the link of a drive, found that of the server or of an ended one"
        )
    return session


SessionDep = Annotated[DriveSession, Depends(require_session)]


async def show_links(host: HostDep, seat: SeatDep) -> Response:
    """Show the links of all drives to the person who started the server."""
    if seat.role != SeatRole.HOST:
        raise DriveRefusal(HTTPStatus.FORBIDDEN, "expected the host's link for the list of links, found a driver's")
    drives = [(name, host.list_links(name)) for name in host.list_drives()]
    return _page("links.html", HTTPStatus.OK, drives=drives)


async def show_driving_page(request: Request, cav: str, seat: SeatDep) -> Response:
    """Return the page of a driver."""
    if seat.role != SeatRole.DRIVER or seat.cav != cav:
        raise DriveRefusal(
            HTTPStatus.FORBIDDEN, f"expected the link of {cav}, found that of {seat.cav or seat.role}"[:200]
        )
    return _send_drive_page(request)


async def show_watching_page(request: Request, seat: SeatDep) -> Response:
    """Return the page of a spectator."""
    if seat.role != SeatRole.SPECTATOR:
        raise DriveRefusal(HTTPStatus.FORBIDDEN, "expected a spectator's link, found another")
    return _send_drive_page(request)


def _send_drive_page(request: Request) -> Response:
    page = read_static_file("drive.html")
    assert page is not None, "the package has the page"
    return send_static_file(request, page, {})


async def send_scene(session: SessionDep) -> Response:
    """Return the packed 3-D scene, see `mdrive_sumo.report.scene_3d`."""
    headers = {"Cache-Control": "no-store"}
    return Response(session.simulation.scene, media_type="application/octet-stream", headers=headers)


async def send_motion(number: int, session: SessionDep) -> Response:
    """Return the packed motion of a take, for scrubbing."""
    if not session.rules.may_rewind:
        raise DriveRefusal(HTTPStatus.FORBIDDEN, "this drive goes on without going back")
    motion = await _load_motion(session, number)
    return Response(motion, media_type="application/octet-stream", headers={"Cache-Control": "no-store"})


async def _load_motion(session: DriveSession, take: int) -> bytes:
    """Return the motion of a take. Raises InputError.

    The process of a take that has just ended may be gone before it answers; then the recording has the motion.
    """
    session.simulation.tree.find(take)
    for _ in range(MOTION_TRIES - 1):
        try:
            return await session.simulation.load_motion(take)
        except InputError:
            await asyncio.sleep(MOTION_PAUSE_S)
    return await session.simulation.load_motion(take)


async def send_file(request: Request, name: str) -> Response:
    """Return a static file."""
    file = read_static_file(name)
    if file is None:
        raise DriveRefusal(HTTPStatus.NOT_FOUND, f"there is nothing at /static/{name:.60}")
    return send_static_file(request, file, {})


# ----------------------------------------------------------------------------------------------------------- WebSocket


async def serve_socket(socket: WebSocket, token: str = "") -> None:
    """Connect a browser to its drive until it leaves."""
    host: DriveHost = socket.app.state.host
    await socket.accept()  # a refusal before would not tell the browser why
    seat = host.tokens.find(token)
    session = host.find_session(seat.session) if seat is not None else None
    if seat is None or session is None:
        await _refuse(socket, NO_SEAT)
        return
    try:
        connection = session.connect(seat)
    except InputError as error:
        await _refuse(socket, str(error))
        return
    sending = asyncio.create_task(_send(socket, connection))
    receiving = asyncio.create_task(_receive(socket, session, connection))
    try:
        await asyncio.wait((sending, receiving), return_when=asyncio.FIRST_COMPLETED)
    finally:
        session.disconnect(connection)
        for task in (sending, receiving):
            task.cancel()
            with suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError):
                await task


async def _refuse(socket: WebSocket, sentence: str) -> None:
    """Tell a browser in one sentence why it has no place, and close."""
    with suppress(WebSocketDisconnect, RuntimeError):
        await socket.send_text(format_problem(sentence))
        await socket.close(POLICY_VIOLATION, _cut_reason(sentence))


async def _send(socket: WebSocket, connection: BrowserConnection) -> None:
    while not isinstance(following := await connection.take_next(), Closing):
        for message in following:
            if isinstance(message, bytes):
                await socket.send_bytes(message)
            else:
                await socket.send_text(message)
    await socket.close(following.code, _cut_reason(following.reason))


async def _receive(socket: WebSocket, session: DriveSession, connection: BrowserConnection) -> None:
    while True:
        message = await socket.receive()
        if message["type"] == "websocket.disconnect":
            if message.get("code") == NORMAL:
                session.disconnect(connection, for_good=True)
            return
        content = message.get("bytes")
        await session.receive(connection, content if content is not None else message["text"])


def _cut_reason(sentence: str) -> str:
    return sentence.encode()[:MAX_REASON_BYTES].decode("utf-8", "ignore")
