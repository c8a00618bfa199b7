"""Applications of the challenge server that tests use one after the other. No tests in here.

FastAPI examines the signatures of all routes for each application anew, which takes as long as ten requests. A test
gets an application that an ended one has left, with services of its own: `take_app`; `release_apps` ends a test.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from fastapi import FastAPI
from starlette.datastructures import State

from server.api.app import _make_services, create_app, install_services
from server.settings import ServerSettings
from server.store import Store
from server.web.mount_pages import connect_pages, mount_pages


@dataclass
class SharedApp:
    """An application, and what its routes are."""

    app: FastAPI
    has_pages: bool
    routes: int

    def is_unchanged(self) -> bool:
        """Whether no test has added a route or replaced a dependency."""
        return len(self.app.router.routes) == self.routes and not self.app.dependency_overrides


_taken: list[SharedApp] = []
_free: list[SharedApp] = []


def take_app(settings: ServerSettings, store: Store, suites: Any, runner: Any, now: Callable[[], int]) -> FastAPI:
    """Return an application without pages, as `create_app` does."""
    shared = _pop_free(has_pages=False)
    if shared is None:
        app = create_app(settings, store, suites, runner, now)
        shared = SharedApp(app, False, len(app.router.routes))
    else:
        shared.app.state = State()
        install_services(shared.app, _make_services(settings, store, suites, runner), now)
    _taken.append(shared)
    return shared.app


def take_app_with_pages(app: FastAPI) -> FastAPI:
    """Return an application with the services of another one, and pages."""
    shared = _pop_free(has_pages=True)
    if shared is None:
        new = create_app(app.state.services.settings, app.state.services.store)
        shared = SharedApp(new, True, 0)
        install_services(new, app.state.services, app.state.now)
        mount_pages(new)
        shared.routes = len(new.router.routes)
    else:
        shared.app.state = State()
        install_services(shared.app, app.state.services, app.state.now)
        connect_pages(shared.app)
    _taken.append(shared)
    return shared.app


def _pop_free(has_pages: bool) -> SharedApp | None:
    found = next((shared for shared in _free if shared.has_pages == has_pages), None)
    if found is not None:
        _free.remove(found)
    return found


def count_taken() -> int:
    """Return how many applications are in use."""
    return len(_taken)


def release_apps(before: int) -> None:
    """Take back the applications that were taken since `count_taken` was `before`."""
    _free.extend(shared for shared in _taken[before:] if shared.is_unchanged())
    del _taken[before:]
