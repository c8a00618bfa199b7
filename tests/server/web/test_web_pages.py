"""Pages beside leaderboards and teams: how to take part, logging in, making a team, errors, files, default phase."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from fastapi.routing import iter_route_contexts
from testing.api_app import HIDDEN, Server, problem
from testing.store_samples import NOON, PHASE
from testing.web_page import Page, Visit, links, sound

from server import web
from server.cli.serve_command import make_app
from server.clock import DAY_US
from server.settings import RegistrationSettings, load_settings
from server.store import StoreUnavailable, audit, phases, teams
from server.web import static_files

pytestmark = pytest.mark.slow


@pytest.fixture
def server(tmp_path: Path) -> Server:
    return Server(tmp_path)


def test_how_to_take_part_has_the_numbers_of_this_server(server: Server) -> None:
    words = Visit(server).get("/how").words
    for word in (
        "Development open", "Past closed", "python3.11-numpy", "not built", "negotiation", "agent-failed", "timeout",
        "http://testserver/api/v1/submissions", "--phase", "64 processes", "60 s to start", "64 KiB packed",
        "ask the organisers",
    ):  # fmt: skip
        assert word in words, word
    assert "suite-marker" not in words and "/register" not in words


def test_the_commands_begin_with_an_installation_that_works(server: Server) -> None:
    """There is no release: a clone, or the wheel that the organisers give."""
    guide = Visit(server).get("/how").words
    assert "from a clone of its repository: pip install '.[server]'" in guide and "mdrive-sumo[server]" not in guide
    wheel = server.folder / "mdrive_sumo-1.0-py3-none-any.whl"
    wheel.write_bytes(b"PK wheel")
    changed = server.settings.model_copy(update={"wheel": wheel})
    server.app.state.services = replace(server.app.state.services, settings=changed)
    visit = Visit(server)
    assert f"pip install 'mdrive-sumo[server] @ http://testserver/download/{wheel.name}'" in visit.get("/how").words
    assert visit.client.get(f"/download/{wheel.name}").content == b"PK wheel"
    visit.get("/download/settings.toml", 404)


def test_logging_in_and_out(server: Server) -> None:
    visit = Visit(server)
    assert "may be mistyped" in sound(visit.post("/login", 401, token="mdrive_x")).words
    assert "may be mistyped" in sound(visit.post("/login", 401)).words
    answer = visit.post("/login", token=f" {server.tokens['red']}\n")
    assert answer.headers["location"] == f"/teams/{server.red}"
    cookie = answer.headers["set-cookie"].lower()
    assert "httponly" in cookie and "samesite=strict" in cookie and "path=/;" in cookie and "secure" not in cookie
    assert "Log out" in visit.get("/how").all("nav", aria_label="Pages")[0].text
    visit.post("/logout")
    assert "Log in" in visit.get("/how").all("nav", aria_label="Pages")[0].text


def test_the_cookie_is_secure_where_the_connection_is(server: Server) -> None:
    visit = Visit(server)
    headers = {"Sec-Fetch-Site": "same-origin"}
    answer = visit.client.post("https://testserver/login", data={"token": server.tokens["red"]}, headers=headers)
    assert "; secure" in answer.headers["set-cookie"].lower()


def test_the_api_does_not_take_the_cookie(server: Server) -> None:
    visit = Visit(server, "red")
    problem(visit.client.get("/api/v1/me"), 401, "Bearer")
    problem(visit.client.get("/api/v1/nope"), 404)


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Sec-Fetch-Site": "same-origin"}, 303),
        ({"Sec-Fetch-Site": "none"}, 303),
        ({"Sec-Fetch-Site": "cross-site"}, 403),
        ({"Sec-Fetch-Site": "same-site", "Origin": "http://testserver"}, 403),
        ({"Origin": "http://testserver"}, 303),
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Origin": "http://["}, 403),
        ({"Origin": "http://testserver.evil.example"}, 403),
        ({}, 403),
    ],
)
def test_forms_of_other_sites_are_refused(server: Server, headers: dict[str, str], status: int) -> None:
    answer = Visit(server, "red").client.post("/logout", headers=headers)
    assert answer.status_code == status
    assert status == 303 or "a page of this server" in sound(answer).words


def test_every_form_is_guarded(server: Server) -> None:
    """Also those that are not there yet: all POSTs outside /api."""
    visit, tried = Visit(server, "admin"), 0
    for path in {route.path for route in _routes(server) if "POST" in (route.methods or ())}:
        if not path.startswith("/api/"):
            for name in ("submission", "team", "token"):
                path = path.replace(f"{{{name}}}", "0" * 32)
            answer = visit.client.post(path, headers={"Sec-Fetch-Site": "cross-site"})
            assert answer.status_code == 403, path
            tried += 1
    assert tried >= 5


def _routes(server: Server) -> list[Any]:
    return [route for route in iter_route_contexts(server.app.routes) if getattr(route, "path", None)]


def test_errors_are_pages_for_people_and_problems_for_programs(server: Server) -> None:
    visit = Visit(server, "red")
    page = visit.get("/nope", 404)
    assert "there is nothing at GET /nope" in page.words and "Log out" in page.all("nav")[0].text
    for path in ("/submissions/abc", "/submissions/abc/scenarios/a/0"):
        assert visit.get(path, 404).words == f"Not Found there is nothing at {path} Leaderboards"
    assert (
        "query key: expected an id of 32 hexadecimal digits"
        in sound(visit.client.post("/submit?key=x", headers={"Sec-Fetch-Site": "none"})).words
    )
    assert "not offered here" in sound(visit.client.delete("/how")).words
    too_long = visit.client.post("/register", data={"name": "x" * 300}, headers={"Sec-Fetch-Site": "none"})
    assert too_long.status_code == 422 and "body name: expected" in sound(too_long).words
    answer = Visit(server).client.post("/teams/x/revoke", headers={"Sec-Fetch-Site": "none"})
    assert answer.status_code in (401, 422)
    problem(visit.client.get("/api/v1/nope"), 404, "/api/v1/nope")


def test_a_database_that_is_away_is_a_page(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    visit = Visit(server, "red")

    def away(*_: object) -> None:
        raise StoreUnavailable("/srv/secret/challenge.sqlite is locked")

    monkeypatch.setattr(server.store, "read", away)
    for path in ("/", "/how", "/teams/red", "/login"):
        answer = visit.client.get(path)
        assert answer.status_code == 503 and answer.headers["retry-after"]
        assert "database does not answer" in sound(answer).words and "secret" not in answer.text


def opened(server: Server, per_day: int = 20) -> Visit:
    """With registration open: every visitor may create a team."""
    changed = server.settings.model_copy(update={"registration": RegistrationSettings(open=True, per_day=per_day)})
    server.app.state.services = replace(server.app.state.services, settings=changed)
    return Visit(server)


def test_registration_is_closed_unless_opened(server: Server) -> None:
    page = Visit(server).get("/register")
    assert "ask the organisers" in page.words and not page.all("input")
    assert "ask the organisers" in sound(Visit(server).post("/register", 403, name="new")).words
    problem(server.ask("POST", "/register", json={"name": "new"}), 403, "ask the organisers")


def test_a_visitor_makes_a_team(server: Server) -> None:
    visit = opened(server)
    assert "/register" in links(visit.get("/how")) and "/register" in links(visit.get("/login"))
    answer = visit.post("/register", 200, name=" new team ")
    page = sound(answer)
    token = page.all("input", id="issued")[0].attributes["value"]
    assert [each.attributes["action"] for each in page.all("form")] == ["/logout"], "Enter in the field does not leave"
    assert answer.headers["cache-control"] == "no-store" and token.startswith("mdrive_")
    server.tokens["new"] = token
    assert server.get("/me", "new")["team"]["name"] == "new team"
    assert "new team" in visit.get("/how").all("nav", aria_label="Pages")[0].text, "and is logged in"
    assert "No results are shown yet" in visit.get("/teams/new%20team").words
    with server.store.read() as session:
        entries = session.query(audit.AuditEntryRow).filter_by(actor="visitor").all()
        assert [entry.action for entry in entries] == ["team-created", "token-issued"] and token not in str(entries)


def test_a_name_that_cannot_be_taken_stays_in_the_form(server: Server) -> None:
    visit = opened(server)
    for name, words in (("red", "'red' is taken"), ("", "expected 1 to 64"), ("a\x00b", "printable")):
        page = sound(visit.post("/register", 422, name=name))
        shown = name.replace("\x00", "\\x00")  # a page holds no characters of control
        assert words in page.words and page.all("input", id="name")[0].attributes["value"] == shown
    problem(server.ask("POST", "/register", json={"name": "red"}), 422, "taken")


def test_so_many_teams_a_day(server: Server) -> None:
    with server.store.read() as session:
        there = len(teams.list_teams(session))
    server.now_us += DAY_US
    visit = opened(server, per_day=2)
    answer = server.ask("POST", "/register", json={"name": "one"})
    assert answer.status_code == 201 and answer.json()["team"]["name"] == "one"
    server.tokens["one"] = answer.json()["token"]
    assert server.get("/me", "one")["scope"] == "submit"
    visit.post("/register", 200, name="two")
    answer = Visit(server).post("/register", 429, name="three")
    assert "all 2 registrations of today are used; the next one is possible at" in sound(answer).words
    assert answer.headers["retry-after"] == str(12 * 3600)
    refused = server.ask("POST", "/register", json={"name": "three"})
    problem(refused, 429, "all 2 registrations")
    assert int(refused.headers["retry-after"]) == 12 * 3600
    server.now_us += DAY_US
    assert server.ask("POST", "/register", json={"name": "three"}).status_code == 201
    with server.store.read() as session:
        assert len(teams.list_teams(session)) == there + 3


def test_what_is_served_beside_pages(server: Server) -> None:
    visit = Visit(server)
    for name in ("site.css", "site.js", "htmx.min.js", "icon.svg"):
        answer = visit.client.get(static_files.static_url(name))
        assert answer.status_code == 200 and "immutable" in answer.headers["cache-control"]
        assert answer.headers["x-content-type-options"] == "nosniff"
    for path in ("/static/0/site.css", "/static/0/..%2fboard.py", "/static/0/HTMX-LICENSE"):
        assert visit.client.get(path).status_code == 404
    css = visit.client.get(static_files.static_url("site.css")).text
    assert "http:" not in css and "//" not in css.replace("*/", "").replace("/*", "")


def test_the_server_has_pages_and_settings_for_them(tmp_path: Path) -> None:
    settings = load_settings(None, {"MDRIVE_DATA": str(tmp_path), "MDRIVE_REGISTRATION__OPEN": "true"})
    assert settings.registration == RegistrationSettings(open=True, per_day=20) and not RegistrationSettings().open
    app = make_app(settings)
    assert any(getattr(route, "path", "") == "/register" for route in iter_route_contexts(app.routes))
    app.state.services.store.close()


@pytest.mark.parametrize("scheme", [0, 1], ids=["light", "dark"])
def test_text_stands_out_from_its_ground(scheme: int) -> None:
    """Contrast by WCAG 2, success criterion 1.4.3."""
    css = (Path(web.__file__).parent / "static" / "site.css").read_text("utf-8")
    colours = dict(re.findall(r"--([a-z-]+): #([0-9a-f]{6});", css.split(":root {")[1 + scheme].split("}")[0]))
    pairs = [
        (ink, on) for ink in ("ink", "soft", "accent", "good", "warn", "bad") for on in ("ground", "raised", "sunk")
    ]
    for ink, ground in (*pairs, ("accent-ink", "accent")):
        light, dark = sorted((_luminance(colours[ink]), _luminance(colours[ground])), reverse=True)
        assert (light + 0.05) / (dark + 0.05) >= 4.5, (ink, ground)


def _luminance(colour: str) -> float:
    parts = (int(colour[i : i + 2], 16) / 255 for i in (0, 2, 4))
    red, green, blue = (part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


@pytest.fixture
def red(server: Server) -> Visit:
    return Visit(server, "red")


def selected(page: Page) -> list[str]:
    """Values of the chosen options of a form, its first one if none is."""
    options = page.all("option")
    return [each.attributes["value"] for each in options if "selected" in each.attributes] or [
        options[0].attributes["value"]
    ]


def test_a_hidden_phase_is_never_the_default(server: Server, red: Visit) -> None:
    """It is the first by its opening time and its id, and its quota is used up by one careless submission."""
    hidden = replace(HIDDEN, id="a-final", opens_us=0)
    with server.store.write() as session:
        phases.set_phases(session, [hidden], NOON)
    assert selected(red.get("/submit")) == ["dev"]
    assert selected(red.get("/submit?phase=a-final")) == ["a-final"]
    commands = red.get("/how").words
    assert "--phase dev " in commands and "-F phase=dev " in commands
    with server.store.write() as session:
        phases.set_phases(session, [replace(PHASE, closes_us=1)], NOON)
    page = red.get("/submit")
    assert selected(page) == [""] and page.all("select", id="phase")[0].attributes["required"] == ""
    assert "--phase PHASE " in red.get("/how").words
