"""Applications of the challenge server that tests use one after the other. No tests in here.

FastAPI examines the signatures of all routes for each application anew, which takes as long as ten requests. A test
gets an application that an ended one has left, with services of its own: `take_app`; `release_apps` ends a test.
"""

from collections.abc import Callable
from typing import Any

from fastapi import FastAPI
from starlette.datastructures import State

from server.api.app import _make_services, create_app, install_services
from server.settings import ServerSettings
from server.store import Store
from server.web.mount_pages import connect_pages, mount_pages

_taken: list[FastAPI] = []
_free: dict[int, list[FastAPI]] = {}
"""By the number of routes: those of the API, and those with pages. A test may add routes, which nobody asks for."""
_sizes: dict[bool, int] = {}


def take_app(settings: ServerSettings, store: Store, suites: Any, runner: Any, now: Callable[[], int]) -> FastAPI:
    """Return an application without pages, as `create_app` does."""
    app = _pop_free(pages=False)
    if app is None:
        app = create_app(settings, store, suites, runner, now)
        _sizes[False] = len(app.router.routes)
    else:
        app.state = State()
        install_services(app, _make_services(settings, store, suites, runner), now)
    _taken.append(app)
    return app


def take_app_with_pages(app: FastAPI) -> FastAPI:
    """Return an application with the services of another one, and pages."""
    found = _pop_free(pages=True)
    if found is None:
        mount_pages(app)
        _sizes[True] = len(app.router.routes)
        return app
    found.state = State()
    install_services(found, app.state.services, app.state.now)
    connect_pages(found)
    _taken.append(found)
    return found


def _pop_free(pages: bool) -> FastAPI | None:
    free = _free.get(_sizes.get(pages, 0), [])
    return free.pop() if free else None


def count_taken() -> int:
    """Return how many applications are in use."""
    return len(_taken)


def release_apps(before: int) -> None:
    """Take back the applications that were taken since `count_taken` was `before`."""
    for app in _taken[before:]:
        if len(app.router.routes) in _sizes.values() and not app.dependency_overrides:
            _free.setdefault(len(app.router.routes), []).append(app)
    del _taken[before:]
