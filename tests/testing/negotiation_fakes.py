"""Cars that negotiate without a simulator: they drive their trajectories, and their messages take a tick or more."""

import json
import math
import threading
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import numpy as np

from mdrive_sumo.contract import Message
from mdrive_sumo.negotiation import NegotiationMember, NegotiationStep, Negotiator
from mdrive_sumo.negotiation.intention import predict_trajectory
from mdrive_sumo.v2x.messages import Direction, Intention


def member(
    name: str, x: float, y: float, yaw: float, speed: float = 6.0, accelerating: float = 0.0
) -> NegotiationMember:
    """A car that goes straight on."""
    way = np.array(((x, y), (x + 100 * math.cos(yaw), y + 100 * math.sin(yaw))))
    points = predict_trajectory(way, speed, accelerating)
    return NegotiationMember(name, x, y, yaw, speed, Intention.KEEP, Direction.FOLLOW, 0.2, points, points)


def crossing(a_run: float = 10.0, b_run: float = 12.0) -> dict[str, NegotiationMember]:
    """Two cars before a crossing at the origin: a from the west, b from the south."""
    return {"a": member("a", -a_run, 0.0, 0.0), "b": member("b", 0.0, -b_run, math.pi / 2)}


def talk(
    cars: Mapping[str, NegotiationMember],
    negotiators: Mapping[str, Negotiator],
    ticks: int,
    latency: int = 1,
    lost: Callable[[str, str, int], bool] = lambda sender, receiver, tick: False,
    first: int = 0,
) -> dict[int, dict[str, NegotiationStep]]:
    """Standing cars talk for so many ticks; every message arrives after `latency` ticks: their steps by tick."""
    sent: list[tuple[int, Message]] = []
    steps: dict[int, dict[str, NegotiationStep]] = {}
    for tick in range(first, first + ticks):
        steps[tick] = {}
        said: list[Message] = []
        for name, negotiator in negotiators.items():
            heard = [m for t, m in sent if t + latency == tick and m.sender != name and not lost(m.sender, name, t)]
            steps[tick][name] = negotiator.step(tick, cars[name], heard)
            said += steps[tick][name].messages
        sent += [(tick, message) for message in said]
    return steps


Answering = Callable[[dict[str, Any]], tuple[int, bytes]]


def completion(text: str, **more: Any) -> bytes:
    """The body of a chat completion."""
    return json.dumps({"choices": [{"message": {"role": "assistant", "content": text}}], **more}).encode()


def agreeable(request: dict[str, Any]) -> tuple[int, bytes]:
    """A model that lets the first car of the list go and stops the others."""
    system, user = (message["content"] for message in request["messages"][:2])
    if "JSON" not in system:
        return 200, completion(f"Whoever is first in the list goes, I agree. ({len(user)})", usage={"total_tokens": 9})
    ids = [line.split()[2].rstrip(":") for line in user.splitlines() if line.startswith("- car ")]
    return 200, completion(json.dumps({name: "STOP" if i else "FASTER" for i, name in enumerate(sorted(ids))}))


@contextmanager
def served(answering: Answering | None, raw: Callable[[BaseHTTPRequestHandler], None] | None = None) -> Generator[Any]:
    """A service at `.url` that answers as told; `.requests` is what it was asked, `.headers` of the last request."""

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["Content-Length"]))
            service.requests.append(json.loads(body))
            service.headers = dict(self.headers)
            if raw is not None:
                raw(self)
                return
            assert answering is not None
            status, answer = answering(service.requests[-1])
            self.send_response(status)
            self.send_header("Content-Length", str(len(answer)))
            self.end_headers()
            self.wfile.write(answer)

        def log_message(self, format: str, *args: Any) -> None:
            pass

    class Service(ThreadingHTTPServer):
        requests: list[dict[str, Any]]
        headers: dict[str, str]
        url: str
        daemon_threads = True
        block_on_close = False

        def handle_error(self, request: Any, client_address: Any) -> None:
            pass  # the client has gone away: that is what some tests want

    service = Service(("127.0.0.1", 0), Handler)
    service.requests, service.headers = [], {}
    service.url = f"http://127.0.0.1:{service.server_address[1]}"
    thread = threading.Thread(target=service.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
    thread.start()
    try:
        yield service
    finally:
        service.shutdown()
        service.server_close()
        thread.join()


def lines_of(steps: Mapping[int, Mapping[str, NegotiationStep]], kind: str) -> list[str]:
    """The notes of a kind, in order."""
    return [
        note.text for by_name in steps.values() for step in by_name.values() for note in step.notes if note.kind == kind
    ]


def texts_of(steps: Mapping[int, Mapping[str, NegotiationStep]]) -> list[tuple[int, str, bytes]]:
    """(tick, sender, payload) of all text messages."""
    return [(t, m.sender, m.payload) for t, by_name in steps.items() for s in by_name.values() for m in s.messages
            if m.type == "text"]  # fmt: skip


def replies(steps: Mapping[int, Mapping[str, NegotiationStep]]) -> Sequence[Any]:
    """Everything that steps say, comparable."""
    return [(t, n, s.decision, s.messages, s.notes) for t, by_name in steps.items() for n, s in by_name.items()]
