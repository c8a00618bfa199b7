"""An in-memory client of an application. No tests in here."""

import warnings
from concurrent.futures import Future
from functools import cache
from threading import Thread
from typing import Any

import anyio
from anyio.from_thread import BlockingPortal
from fastapi import FastAPI

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # Starlette would rather have httpx2, a package of its own
    from fastapi.testclient import TestClient


class Client(TestClient):
    """Starlette's, but all requests of a process share one event loop: a loop of its own costs as much as a request."""

    def __init__(self, app: FastAPI, **options: Any) -> None:
        super().__init__(app, **options)
        self.portal = start_event_loop()


@cache
def start_event_loop() -> BlockingPortal:
    """Return the way into an event loop that runs in a thread until the process ends."""
    started: Future[BlockingPortal] = Future()

    async def run() -> None:
        async with BlockingPortal() as portal:
            started.set_result(portal)
            await portal.sleep_until_stopped()

    Thread(target=anyio.run, args=(run,), name="event loop of clients", daemon=True).start()
    return started.result(60.0)
