"""The server of `drive` over real sockets: pages, tokens, other hosts and origins, the WebSocket, logs."""

import json
import logging
import re
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
from testing.drive_fakes import FakeSimulation, make_setup
from testing.drive_server import DriveServer, serve_drive
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from mdrive_sumo.contract import Control
from mdrive_sumo.core.errors import InputError
from server.drive.access import HostCheck, TokenFilter
from server.drive.protocol import DriveInput, InputDevice, decode_frame, encode_input

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Generator[DriveServer]:
    with serve_drive(folder=tmp_path_factory.mktemp("drive"), people=("ego_0", "ego_1")) as served:
        yield served


@contextmanager
def open_socket(server: DriveServer, token: str, **options: Any) -> Generator[ClientConnection]:
    with connect(f"ws://127.0.0.1:{server.port}/socket?token={token}", **options) as socket:
        yield socket


def read_closing(socket: ClientConnection) -> tuple[list[str], int, str]:
    """The problems that are told before the server closes, its code and its reason."""
    told: list[str] = []
    while True:
        try:
            message = socket.recv(timeout=20)
        except ConnectionClosed as closed:
            assert closed.rcvd is not None
            return told, closed.rcvd.code, closed.rcvd.reason
        if isinstance(message, str) and (content := json.loads(message))["is"] == "problem":
            told.append(content["text"])


def test_pages_need_their_own_token(server: DriveServer) -> None:
    driver, watcher = server.link("ego_0"), server.link()
    for path in (driver, watcher):
        page = httpx.get(server.url + path)
        assert page.status_code == 200
        assert "<title>Drive" in page.text
        assert "script-src 'self'" in page.headers["content-security-policy"]
        assert "unsafe" not in page.headers["content-security-policy"]
        assert page.headers["referrer-policy"] == "no-referrer"
        assert "frame-ancestors 'none'" in page.headers["content-security-policy"]
    for path, status, sentence in (
        ("/drive/ego_0", 403, "expected the whole link with its token, found an address without one"),
        ("/drive/ego_0?token=guess", 403, "this link is not valid: links end with the server that printed them"),
        (f"/drive/ego_1?token={server.token('ego_0')}", 403, "expected the link of ego_1, found that of ego_0"),
        (f"/watch?token={server.token('ego_0')}", 403, "expected a spectator&#39;s link, found another"),
        (f"/drive/ego_0?token={server.token()}", 403, "expected the link of ego_0, found that of spectator"),
        ("/scene", 403, "expected the whole link"),
        (f"/?token={server.token('ego_0')}", 403, "expected the host&#39;s link for the list of links"),
        ("/nothing", 404, "there is nothing at GET /nothing"),
        ("/static/nothing.js", 404, "there is nothing at /static/nothing.js"),
        ("/static/%2e%2e%2fdrive_app.py", 404, "there is nothing at"),
        (f"/static/{'x' * 3000}.js", 404, "there is nothing at /static/xxx"),
        ("/static/%00.js", 404, "there is nothing at /static/"),
        (f"/takes/9/motion?token={server.token()}", 422, "take: expected one of this drive (1 to 1), found 9"),
        (f"/takes/x/motion?token={server.token()}", 422, "path number: expected a valid integer"),
        (f"/scene?token={server.host.host_token}", 404, "expected the link of a drive"),
    ):
        answer = httpx.get(server.url + path)
        assert (answer.status_code, sentence in answer.text) == (status, True), (path, answer.status_code, answer.text)
        assert "\n<h1>" in answer.text


def test_the_host_sees_all_links(server: DriveServer) -> None:
    page = httpx.get(f"{server.url}/?token={server.host.host_token}")
    for cav in ("ego_0", "ego_1", ""):
        assert server.link(cav).replace("&", "&amp;") in page.text
    assert page.headers["cache-control"] == "no-store"


def test_scene_and_motion_are_sent_to_all_with_a_link(server: DriveServer) -> None:
    assert httpx.get(f"{server.url}/scene?token={server.token()}").content == b"scene"
    assert httpx.get(f"{server.url}/takes/1/motion?token={server.token('ego_0')}").content == b"motion"


def test_static_files_are_kept_by_browsers(server: DriveServer) -> None:
    page = httpx.get(server.url + server.link("ego_0"))
    names = re.findall(r'(?:src|href)="/static/([\w.-]+)"', page.text)
    assert names
    for name in names:
        file = httpx.get(f"{server.url}/static/{name}")
        assert file.status_code == 200, name
        again = httpx.get(f"{server.url}/static/{name}", headers={"If-None-Match": file.headers["etag"]})
        assert (again.status_code, again.content) == (304, b"")
        plain = httpx.get(f"{server.url}/static/{name}", headers={"Accept-Encoding": "identity"})
        assert plain.content == file.content


MALFORMED_HOSTS = (
    *("evil@127.0.0.1", "evil:secret@127.0.0.1:8420", "@localhost", "127.0.0.1/evil", "127.0.0.1?evil"),
    *(
        "127.0.0.1#evil",
        "127.0.0.1:",
        "127.0.0.1:x",
        "[127.0.0.1]evil",
        "[::1",
        "//127.0.0.1",
        "127.0.0.1\n",
        "127.0.0.1 ",
    ),
    *("\\127.0.0.1", "127.0.0.1\u0660", "a@b@c:x", ""),
)


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:80", "127.0.0.1.evil.example", "", "[::1", "a@b@c:x", "evil@127.0.0.1"]
)
def test_other_host_names_are_refused(host: str, server: DriveServer) -> None:
    answer = httpx.get(server.url + server.link("ego_0"), headers={"Host": host})
    assert answer.status_code in (400, 421)
    assert server.token("ego_0") not in answer.text
    with (
        pytest.raises(InvalidStatus) as refused,
        open_socket(server, server.token(), additional_headers={"Host": host}),
    ):
        pass
    assert refused.value.response.status_code in (400, 403)


def test_pages_of_other_sites_open_no_socket(server: DriveServer) -> None:
    for origin in ("http://evil.example", "null", f"http://localhost:{server.port}", "http://127.0.0.1", "http://["):
        with pytest.raises(InvalidStatus) as refused, open_socket(server, server.token(), origin=origin):  # pyright: ignore[reportArgumentType]
            pass
        assert refused.value.response.status_code == 403
    with open_socket(server, server.token(), origin=server.url) as socket:  # pyright: ignore[reportArgumentType]
        assert json.loads(socket.recv(timeout=20))["is"] == "welcome"


@pytest.mark.parametrize(
    ("host", "origin", "allowed"),
    [
        ("127.0.0.1:8420", "http://127.0.0.1:8420", True),
        ("localhost:8420", "http://localhost:8420", True),
        ("[::1]:8420", "http://[::1]:8420", True),
        ("192.168.1.7:8420", "http://192.168.1.7:8420", True),
        ("drive.example", "https://drive.example", True),
        ("DRIVE.example", "https://drive.example", True),
        ("drive.example", "https://drive.example.evil", False),
        ("drive.example", "file://drive.example", False),
        ("other.example", "https://other.example", False),
        ("drive.example", None, True),
        ("drive-2.example", None, False),
        *((host, None, False) for host in MALFORMED_HOSTS),
    ],
)
def test_hosts_and_origins(host: str, origin: str | None, allowed: bool) -> None:
    check = HostCheck(["drive.example"])
    assert (check.is_host_allowed(host) and check.is_origin_allowed(origin, host)) is allowed


def test_a_driver_drives_over_the_socket(server: DriveServer) -> None:
    with open_socket(server, server.token("ego_0")) as socket:
        welcome = json.loads(socket.recv(timeout=20))
        assert (welcome["is"], welcome["cav"]) == ("welcome", "ego_0")
        socket.send(encode_input(DriveInput(InputDevice.SCRIPT, 1, 0.0, Control(1.0, 0.0, 0.0))))
        socket.send('{"do":"ping","time":3.5}')
        told: list[Any] = []
        while {"is": "pong", "time": 3.5} not in told:
            message = socket.recv(timeout=20)
            told.append(decode_frame(message) if isinstance(message, bytes) else json.loads(message))
        assert server.call(lambda: list(server.simulation.inputs)) == [("ego_0", 1, Control(1.0, 0.0, 0.0))]
        with open_socket(server, server.token("ego_0")) as second:
            told, code, reason = read_closing(second)
        sentence = "ego_0: expected a free seat, found a driver at the wheel; a spectator's link shows the drive"
        assert (told, code, reason) == ([sentence], 1008, sentence)
        socket.send("{")
        socket.send("still here?")
        assert [json.loads(socket.recv(timeout=20))["text"] for _ in range(2)] == 2 * [
            "message: expected JSON, found other text"
        ]


def test_unknown_tokens_are_told_why(server: DriveServer) -> None:
    for token in ("", "guess", server.host.host_token):
        with open_socket(server, token) as socket:
            told, code, reason = read_closing(socket)
        assert code == 1008
        assert told[0].startswith(reason)
        assert reason.startswith("this link is not valid")


def test_too_large_a_message_ends_the_connection(server: DriveServer) -> None:
    with open_socket(server, server.token()) as socket:
        socket.send("x" * 20_000)
        assert read_closing(socket)[1] == 1009


def test_no_token_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    record = logging.makeLogRecord(
        {"msg": '%s - "WebSocket %s" [accepted]', "args": ("x", "/socket?token=s3-c_ret&a=1")}
    )
    assert TokenFilter().filter(record)
    assert record.getMessage() == 'x - "WebSocket /socket?token=...&a=1" [accepted]'


def test_an_unknown_scenario_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^scenario 'unknown': expected"):  # noqa: SIM117
        with serve_drive(make_setup(tmp_path).__class__("unknown", tmp_path)):
            pass


def test_a_simulation_that_ends_is_started_anew(tmp_path: Path) -> None:
    made: list[FakeSimulation] = []

    def make() -> FakeSimulation:
        made.append(FakeSimulation())
        return made[-1]

    with serve_drive(folder=tmp_path, make_simulation=make) as server:
        with open_socket(server, server.token("ego_0")) as socket:
            socket.recv(timeout=20)
            server.call(made[0].end)
            assert read_closing(socket)[1:] == (1001, "the simulation has ended")
        with open_socket(server, server.token("ego_0")) as socket:
            assert json.loads(socket.recv(timeout=20))["is"] == "welcome"
        assert len(made) == 2
