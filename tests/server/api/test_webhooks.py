"""Webhooks: signed, tried a bounded number of times, only to public addresses, with what the team may see anyway."""

import asyncio
import base64
import hashlib
import hmac
import json
import socket
from collections.abc import Sequence
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

import httpx
import pytest
from testing.api_app import HIDDEN, Server, problem
from testing.api_submissions import drive_submissions
from testing.store_samples import all_of

from server.api.webhook_sender import WebhookSender
from server.settings import WebhookSettings
from server.store import submissions, webhooks
from server.store.tables import WebhookDeliveryRow

PUBLIC = "93.184.215.14"
HOOK = "https://ci.example/hook"


@dataclass
class Receiver:
    """Answers in place of the network."""

    status: int = 204
    addresses: Sequence[str] = (PUBLIC,)
    got: list[httpx.Request] = field(default_factory=list)
    delay_s: float = 0.0

    async def answer(self, request: httpx.Request) -> httpx.Response:
        self.got.append(request)
        await asyncio.sleep(self.delay_s)
        return httpx.Response(self.status, headers={"Location": "http://169.254.169.254/"})

    async def resolve(self, host: str, port: int) -> Sequence[str]:
        if not self.addresses:
            raise OSError("unknown name")
        return self.addresses

    def sender(self, server: Server, **changed: Any) -> WebhookSender:
        settings = WebhookSettings(enabled=True, **changed)
        return WebhookSender(
            server.store, settings, lambda: server.now_us, self.resolve, httpx.MockTransport(self.answer)
        )


@pytest.fixture
def server(tmp_path: Path) -> Server:
    return Server(tmp_path)


def hooked(server: Server, who: str = "red", url: str = HOOK) -> str:
    """Sets a webhook; its secret."""
    answer = server.ask("PUT", "/webhook", who, json={"url": url})
    assert answer.status_code == 200, answer.text
    return answer.json()["secret"]


def cancelled(server: Server, who: str = "red") -> str:
    """A submission that has ended."""
    server.now_us += 1_000_000
    mine = server.send(who, phase="dev").json()["id"]
    assert server.ask("POST", f"/submissions/{mine}/cancel", who).status_code == 200
    return mine


def is_signed(request: httpx.Request, secret: str) -> bool:
    """As the text of Standard Webhooks says: https://www.standardwebhooks.com, "Signature scheme"."""
    signed = b".".join((request.headers["webhook-id"].encode(), request.headers["webhook-timestamp"].encode()))
    mac = hmac.new(base64.b64decode(secret[len("whsec_") :]), signed + b"." + request.content, hashlib.sha256)
    return request.headers["webhook-signature"] == "v1," + base64.b64encode(mac.digest()).decode()


@pytest.mark.slow
def test_the_end_of_a_submission_is_told_once_and_signed(server: Server) -> None:
    secret, receiver = hooked(server), Receiver()
    mine = server.send("red").json()["id"]
    sender = receiver.sender(server)
    assert sender.send_due() == 0, "it is not finished"
    drive_submissions(server, mine)
    server.now_us += 1_000_000
    assert (sender.send_due(), sender.send_due()) == (1, 0)
    (request,) = receiver.got
    assert is_signed(request, secret) and not is_signed(request, hooked(server, "blue"))
    assert (request.url.host, request.headers["host"]) == (PUBLIC, "ci.example"), "connects to what was checked"
    assert request.extensions["sni_hostname"] == "ci.example"
    said = json.loads(request.content)
    assert said["type"] == "submission.finished" and said["data"] == server.get(f"/submissions/{mine}", "red")
    (told,) = server.get("/webhook", "red")["deliveries"]
    assert told == {
        "id": request.headers["webhook-id"], "submission": mine, "state": "delivered", "attempts": 1, "problem": "",
    }  # fmt: skip
    assert server.get("/webhook", "blue")["deliveries"] == []


def test_a_hidden_phase_tells_what_the_api_tells(server: Server) -> None:
    hooked(server)
    receiver = Receiver()
    mine = server.send("red", phase=HIDDEN.id).json()["id"]
    drive_submissions(server, mine, ds=55.5123)
    server.now_us += 1_000_000
    receiver.sender(server).send_due()
    said = json.loads(receiver.got[0].content)
    assert said["data"] == server.get(f"/submissions/{mine}", "red") and said["timestamp"].endswith("12:00:00Z")
    assert said["data"]["summary"]["overall"]["ds"] == 55.5 and said["data"]["summary"]["buckets"] == {}


@pytest.mark.slow
def test_a_receiver_that_refuses_is_asked_five_times(server: Server) -> None:
    """A redirect is a refusal: it is not followed."""
    hooked(server)
    cancelled(server)
    receiver, waits = Receiver(302), []
    sender, begun_us = receiver.sender(server), server.now_us
    for _ in range(300):
        if sender.send_due():
            waits.append((server.now_us - begun_us) // 60_000_000)
        server.now_us += 60_000_000
    assert waits == [0, 1, 6, 36, 156] and len(receiver.got) == webhooks.MAX_ATTEMPTS
    assert len({request.headers["webhook-id"] for request in receiver.got}) == 1
    (told,) = server.get("/webhook", "red")["deliveries"]
    assert (told["state"], told["problem"]) == ("failed", "the receiver answered 302")


def test_a_server_that_dies_while_sending_tries_again_but_not_for_ever(server: Server) -> None:
    hooked(server)
    cancelled(server)
    for attempt in range(1, webhooks.MAX_ATTEMPTS + 1):
        with server.store.write() as session:
            (claimed,) = webhooks.claim_due(session, 8, server.now_us)
            assert claimed.attempt == attempt and webhooks.claim_due(session, 8, server.now_us) == []
        server.now_us += 10**11
    with server.store.write() as session:
        assert webhooks.claim_due(session, 8, server.now_us) == []
    assert server.get("/webhook", "red")["deliveries"][0]["state"] == "failed"


def test_an_address_of_the_inside_is_never_asked(server: Server) -> None:
    hooked(server)
    cancelled(server)
    receiver = Receiver(addresses=("169.254.169.254",))
    assert receiver.sender(server).send_due() == 1 and receiver.got == []
    (told,) = server.get("/webhook", "red")["deliveries"]
    assert told["problem"] == "the name leads to an address that is not public"


def test_a_name_that_changes_after_the_look_changes_nothing(server: Server) -> None:
    """DNS rebinding: public when it is checked, inside when it is used. It is looked up once for each attempt."""
    hooked(server)
    cancelled(server)
    answers, looks = [(PUBLIC,), ("127.0.0.1",), ("::ffff:169.254.169.254",), (PUBLIC, "10.0.0.1")], list[str]()
    receiver = Receiver(500)

    async def resolve(host: str, port: int) -> Sequence[str]:
        looks.append(host)
        return answers[len(looks) - 1]

    sender = WebhookSender(
        server.store,
        WebhookSettings(enabled=True),
        lambda: server.now_us,
        resolve,
        httpx.MockTransport(receiver.answer),
    )
    for attempt in range(1, len(answers) + 1):
        assert sender.send_due() == 1 and looks == ["ci.example"] * attempt
        assert [request.url.host for request in receiver.got] == [PUBLIC], (
            "only the first is asked, at what was checked"
        )
        server.now_us += 10**10
    assert (
        server.get("/webhook", "red")["deliveries"][0]["problem"] == "the name leads to an address that is not public"
    )


def test_public_addresses_are_asked_in_turn(server: Server) -> None:
    hooked(server)
    cancelled(server)
    addresses = (PUBLIC, "2606:4700::1111", "2a00:1450:4001::5")
    receiver = Receiver(500, addresses)
    for _ in addresses:
        receiver.sender(server).send_due()
        server.now_us += 10**10
    assert [request.url.host for request in receiver.got] == list(addresses)
    assert str(receiver.got[1].url) == "https://[2606:4700::1111]/hook"


def test_a_refused_address_changes_nothing(server: Server) -> None:
    problem(server.ask("PUT", "/webhook", "red", json={"url": "https://10.0.0.1/"}), 422, "expected a public address")
    assert server.get("/webhook", "red")["url"] is None


def test_an_address_that_was_allowed_once_is_checked_again(server: Server) -> None:
    """The operator took it from the list."""
    with server.store.write() as session:
        webhooks.set_webhook(session, server.red, "http://hooks.internal/", server.now_us, "server")
    cancelled(server)
    receiver = Receiver(addresses=("10.0.0.1",))
    receiver.sender(server).send_due()
    assert receiver.got == []
    server.now_us += 60_000_000
    receiver.sender(server, allowed_hosts=("hooks.internal",)).send_due()
    assert [request.url.host for request in receiver.got] == ["10.0.0.1"]


@pytest.mark.slow
def test_a_slow_receiver_delays_its_own_team_only(server: Server) -> None:
    for who in ("red", "blue"):
        hooked(server, who)
    for _ in range(3):
        cancelled(server)
    cancelled(server, "blue")
    receiver = Receiver(delay_s=60.0)
    assert receiver.sender(server, timeout_s=0.05).send_due() == 2, "one of each team"
    for who in ("red", "blue"):
        told = server.get("/webhook", who)["deliveries"]
        assert [each["problem"] for each in told if each["attempts"]] == ["no answer within 0.05 s"]


def test_nothing_is_sent_in_the_transaction_or_after_the_webhook_is_removed(server: Server) -> None:
    hooked(server)
    mine = server.send("red").json()["id"]
    with pytest.raises(RuntimeError), server.store.write() as session:
        submissions.cancel(session, mine, server.now_us)
        raise RuntimeError("rolled back")
    with server.store.read() as session:
        assert all_of(session, WebhookDeliveryRow) == []
    cancelled(server, "blue")
    server.ask("POST", f"/submissions/{mine}/cancel", "red")
    assert server.ask("DELETE", "/webhook", "red").status_code == 204
    receiver = Receiver()
    assert receiver.sender(server).send_due() == 0 and receiver.got == []
    assert server.get("/webhook", "red")["url"] is None


def test_a_server_that_sends_none_says_so(server: Server) -> None:
    object.__setattr__(server.settings, "webhooks", WebhookSettings())
    problem(server.ask("PUT", "/webhook", "red", json={"url": HOOK}), 403, "enabled = true")
    assert server.get("/webhook", "red")["enabled"] is False


def test_a_real_receiver_gets_it_from_the_thread(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    """The connection goes to the address that the sender found: nothing else looks the name up."""
    looks: list[str | bytes | None] = []
    look_up = socket.getaddrinfo
    monkeypatch.setattr(
        socket, "getaddrinfo", lambda host, *more, **other: looks.append(host) or look_up(host, *more, **other)
    )
    got: list[tuple[str, bytes]] = []

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            got.append((self.headers["Host"], self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(204)
            self.end_headers()

        def log_message(self, format: str, *args: Any) -> None:
            pass

    http = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = Thread(target=http.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    with server.store.write() as session:
        url = f"http://localhost:{http.server_port}/hook"
        webhooks.set_webhook(session, server.red, url, server.now_us, "server")
    mine = cancelled(server)
    sender = WebhookSender(
        server.store, WebhookSettings(enabled=True, allowed_hosts=("localhost",)), lambda: server.now_us
    )
    sender.start()
    try:
        for _ in range(500):
            if server.get("/webhook", "red")["deliveries"][0]["state"] == "delivered":
                break
            sender._stopping.wait(0.01)
    finally:
        sender.stop()
        http.shutdown()
        thread.join()
        http.server_close()
    assert looks.count("localhost") == 1 and set(looks) <= {"localhost", "127.0.0.1", "::1"}
    ((host, body),) = got
    assert host == f"localhost:{http.server_port}" and json.loads(body)["data"]["id"] == mine
