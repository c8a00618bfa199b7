"""Access to every route for each kind of caller, headers of what only some may see, and the audit log."""

from dataclasses import replace

import pytest
from fastapi.dependencies.models import Dependant
from fastapi.routing import APIRoute
from testing import archive_samples, store_samples
from testing.api_app import API, Server, another_zip, problem
from testing.store_samples import GOOD, LEASE, PHASE, S, summary
from testing.web_page import Visit

from server import paths
from server.api.app import ROUTERS
from server.api.dependencies import get_optional_caller, require_caller
from server.enums import TokenScope
from server.store import audit, jobs, submissions, teams, tokens
from server.store.phases import set_phases
from server.store.tables import AuditEntryRow

WHO = ("", "blue", "red", "worker", "admin")
"""No token, another team, the submission's own team, a worker, an admin."""
PUBLIC = "200 200 200 200 200"
NO_OTHERS = "401 404 200 404 200"
ADMINS = "401 403 403 403 200"
TEAMS = "401 200 200 403 403"
SCENARIO = "/submissions/{submission}/scenarios/left-turn/0"
ACCESS = {
    "GET /me": "401 200 200 200 200",
    "GET /teams": ADMINS,
    "POST /teams": ADMINS.replace("200", "201"),
    "PUT /teams/{name}/hidden": ADMINS,
    "GET /teams/{name}/tokens": ADMINS,
    "POST /tokens": ADMINS.replace("200", "201"),
    "DELETE /tokens/{token}": ADMINS.replace("200", "204"),
    "POST /register": "403 403 403 403 403",  # closed, unless the settings open it
    "GET /webhook": TEAMS,
    "PUT /webhook": TEAMS,
    "DELETE /webhook": TEAMS.replace("200", "204"),
    "GET /phases": PUBLIC,
    "GET /phases/{phase}": PUBLIC,
    "GET /phases/{phase}/matrix": ADMINS,
    "GET /phases/{phase}/cross-play": "404 404 404 404 404",  # the phase has no such board
    "GET /phases/{phase}/ranking": PUBLIC,
    "GET /phases/{phase}/quota": "401 200 200 403 403",
    "POST /submissions": "401 415 415 403 403",  # the body is looked at after the token
    "GET /submissions": "401 200 200 200 200",
    "GET /submissions/{submission}": "404 404 200 404 200",
    "POST /submissions/{submission}/cancel": NO_OTHERS,
    "PUT /submissions/{submission}/shown": NO_OTHERS,
    "POST /submissions/{submission}/disqualify": ADMINS,
    "POST /submissions/{submission}/rerun": ADMINS.replace("200", "201"),
    "GET /submissions/{submission}/scenarios": "404 404 200 404 200",
    "GET /submissions/{submission}/scenarios.csv": "404 404 200 404 200",
    "GET /submissions/{submission}/compare/{other}": "404 404 200 404 200",
    "GET /submissions/{submission}/scenarios/{scenario}/{seed}/recording": "404 404 404 404 404",  # there is none yet
    "GET /submissions/{submission}/scenarios/{scenario}/{seed}/replay": "404 404 404 404 404",
    "GET /submissions/{submission}/scenarios/{scenario}/{seed}/logs/{cav}": "401 404 404 404 404",
    "GET /submissions/{submission}/events": NO_OTHERS,
    "GET /leaderboards/{phase}": PUBLIC,
    "GET /leaderboards/{phase}/teams/{team}": PUBLIC,
    "GET /search": PUBLIC,
    "GET /health": PUBLIC,
    "GET /metrics": "401 403 403 200 200",
    "GET /audit": ADMINS,
}
"""Of a submission that is queued, in the order of `WHO`."""
MORE_WITH_A_TOKEN = (
    *("/search", "/phases/{phase}/cross-play", "/submissions/{submission}", "/submissions/{submission}/scenarios"),
    *("/submissions/{submission}/scenarios.csv", "/submissions/{submission}/compare/{other}"),
    *(f"/submissions/{{submission}}/scenarios/{{scenario}}/{{seed}}/{what}" for what in ("recording", "replay")),
)
"""Operations for everybody that show the holder of a token more: docs/pages.md and docs/api.md, "Results"."""
BODIES = {
    "POST /teams": {"name": "green"},
    "PUT /teams/{name}/hidden": {"hidden": False},
    "POST /tokens": {"scope": "worker"},
    "PUT /webhook": {"url": "https://ci.example/hook"},
    "POST /register": {"name": "green"},
    "PUT /submissions/{submission}/shown": {"shown": True},
    "POST /submissions/{submission}/disqualify": {"reason": "it cheats"},
}


def sent(server: Server, number: int = 0, **fields: str) -> str:
    return server.send(data=another_zip(number), **fields).json()["id"]


def queued(server: Server) -> str:
    """Another one of red's."""
    server.now_us += S
    with server.store.write() as session:
        found = store_samples.sent(session, server.red, server.now_us)
    paths.archive_path(server.settings, found.archive_sha256).touch()
    return found.id


def filled(server: Server, path: str, submission: str) -> str:
    with server.store.write() as session:
        blue = teams.get(session, "blue")
        tokens.issue(session, blue, TokenScope.SUBMIT, server.now_us + len(tokens.list_tokens(session, blue)))
        token = tokens.list_tokens(session, blue)[-1].id
    values = {"submission": submission, "scenario": "left-turn", "seed": "0", "cav": "cav-1", "phase": "dev"}
    if "{other}" in path:
        values["other"] = queued(server)
    for name, value in (values | {"name": "red", "team": "red", "token": token}).items():
        path = path.replace(f"{{{name}}}", value)
    return f"{path}?q=red" if path == "/search" else path


def test_every_route_has_its_line(server: Server) -> None:
    described = server.app.openapi()["paths"].items()
    assert {f"{method.upper()} {path.removeprefix(API)}" for path, methods in described for method in methods} == set(
        ACCESS
    )


def test_the_description_says_where_a_token_is_needed(server: Server) -> None:
    """Operations for everybody were described as if they needed one. What happens, says ACCESS: 401 without a token."""
    token: dict[str, list[str]] = {"HTTPBearer": []}
    described = server.app.openapi()
    assert list(described["components"]["securitySchemes"]) == ["HTTPBearer"]
    found = {
        f"{method.upper()} {path.removeprefix(API)}": operation.get("security")
        for path, methods in described["paths"].items()
        for method, operation in methods.items()
    }
    for operation, statuses in ACCESS.items():
        is_needed = statuses.startswith("401")
        assert found[operation] in ([[token]] if is_needed else [None, [{}, token]]), operation
    assert {name for name, security in found.items() if security == [{}, token]} == {
        f"GET {path}" for path in MORE_WITH_A_TOKEN
    }


def test_the_description_agrees_with_the_dependencies(server: Server) -> None:
    """Of every route, pages excepted: none reads the caller without saying so, or says so without reading it."""
    described = server.app.openapi()["paths"]
    routes = [route for router in ROUTERS for route in router.routes if isinstance(route, APIRoute)]
    assert {API + route.path for route in routes} == set(described)
    for route in routes:
        method = "".join(route.methods or ())
        security = described[API + route.path][method.lower()].get("security")
        used = dependencies_of(route.dependant)
        assert (get_optional_caller in used) == (security is not None), route.path
        assert (require_caller in used) == (security is not None and {} not in security), route.path


def dependencies_of(dependant: Dependant) -> set[object]:
    return {dependant.call}.union(*(dependencies_of(each) for each in dependant.dependencies))


@pytest.mark.slow
def test_who_may_do_what(server: Server) -> None:
    with server.store.write() as session:
        set_phases(session, [replace(PHASE, per_day=500, in_parallel=500, in_total=500)], server.now_us)
    found: dict[str, str] = {}
    for operation in ACCESS:
        method, path = operation.split()
        statuses: list[str] = []
        for who in WHO:
            submission = queued(server) if "{submission}" in path else ""
            if operation.endswith("/events"):  # else they would go on
                with server.store.write() as session:
                    submissions.cancel(session, submission, server.now_us)
            answer = server.ask(method, filled(server, path, submission), who, json=BODIES.get(operation))
            statuses.append(str(answer.status_code))
        found[operation] = " ".join(statuses)
    assert found == ACCESS


def test_other_teams_cannot_read_what_a_team_does_not_show(server: Server) -> None:
    mine = sent(server)
    with server.store.write() as session:
        while (job := jobs.claim(session, "w", LEASE, server.now_us)) is not None:
            jobs.finish(session, job.id, "w", job.attempt, GOOD, server.now_us + S)
        submissions.finish_if_complete(session, mine, summary(80.0), server.now_us + S)
    paths = (f"/submissions/{mine}", f"/submissions/{mine}/scenarios")
    assert [server.ask("GET", path).status_code for path in paths] == [200, 200]
    assert server.get(paths[0])["archive_sha256"] is None and server.get(paths[0], "red")["archive_sha256"]
    assert server.ask("PUT", f"/submissions/{mine}/shown", "red", json={"shown": False}).status_code == 200
    assert [server.ask("GET", path, who).status_code for path in paths for who in ("", "blue")] == [404] * 4


@pytest.mark.slow
@pytest.mark.parametrize("part", ["%2e%2e", "..%2f..%2fetc%2fpasswd", "a%2f..%2fb", "%00", ".hidden", "x%0aINFO: y"])
def test_no_part_of_a_path_is_a_path(server: Server, part: str) -> None:
    mine = sent(server)
    one = f"/submissions/{mine}/scenarios"
    for path in (
        f"/submissions/{part}", f"{one}/{part}/0/recording", f"{one}/left-turn/0/logs/{part}", f"{one}/{part}/0/replay",
        f"/phases/{part}", f"/leaderboards/{part}", f"/teams/{part}/tokens",
    ):  # fmt: skip
        assert server.ask("GET", path, "admin").status_code in (404, 422), path


def test_answers_for_one_team_are_not_cached(server: Server) -> None:
    mine = sent(server)
    own = server.ask("GET", f"/submissions/{mine}", "red").headers
    assert (own["cache-control"], own["x-content-type-options"]) == ("no-store", "nosniff")
    everybodys = server.ask("GET", "/phases").headers
    assert (everybodys["cache-control"], everybodys["x-content-type-options"]) == ("no-cache", "nosniff")
    assert server.ask("GET", "/nothing", "red").headers["cache-control"] == "no-store"


@pytest.mark.parametrize("name", ["RED", "ｒｅｄ", "r" + "ed ", "0" * 32])
def test_no_team_looks_like_another(server: Server, name: str) -> None:
    problem(server.ask("POST", "/teams", "admin", json={"name": name}), 422, "name of a team")


def test_an_environment_that_is_not_built_is_refused_at_once(server: Server) -> None:

    torch = archive_samples.packed({**archive_samples.GOOD, "model_env.yaml": b"environment: python3.11-torch-cpu"})
    said = problem(server.send(data=torch), 422, "expected one of python3.11-numpy, found python3.11-torch-cpu")
    assert said["type"].endswith(":archive") and str(server.folder) not in said["detail"]
    assert server.get("/submissions", "red")["items"] == []


def test_the_audit_log_says_who_did_it(server: Server) -> None:
    mine = sent(server)
    server.ask("PUT", f"/submissions/{mine}/shown", "red", json={"shown": False})
    server.ask("POST", f"/submissions/{mine}/cancel", "red")
    server.ask("POST", f"/submissions/{mine}/disqualify", "admin", json={"reason": "it cheats"})
    server.ask("POST", f"/submissions/{mine}/rerun", "admin")
    with server.store.read() as session:
        admin = tokens.find_token(session, server.tokens["admin"])
        done = [(entry.action, entry.actor) for entry in store_samples.all_of(session, AuditEntryRow)][-4:]
    assert admin is not None and done == [
        ("submission-shown", f"submit:{server.red}"), ("submission-cancelled", f"submit:{server.red}"),
        ("submission-disqualified", f"admin:{admin.id}"), ("submission-rerun", f"admin:{admin.id}"),
    ]  # fmt: skip


@pytest.mark.slow
def test_the_audit_log_says_who_made_teams_and_tokens(server: Server) -> None:
    """By the API, then by the pages."""
    page = Visit(server, "admin")
    server.ask("POST", "/teams", "admin", json={"name": "green"})
    server.ask("PUT", "/teams/green/hidden", "admin", json={"hidden": True})
    server.ask("POST", "/tokens", "admin", json={"team": "green"})
    server.ask("DELETE", f"/tokens/{server.get('/teams/green/tokens', 'admin')['items'][0]['id']}", "admin")
    page.post("/admin/teams", 200, name="grey")
    page.post(f"/admin/teams/{server.red}/hidden", hidden="true")
    page.post("/admin/tokens", 200, scope="worker")
    page.post(f"/admin/tokens/{server.get('/teams/red/tokens', 'admin')['items'][0]['id']}/revoke")
    with server.store.read() as session:
        admin = tokens.find_token(session, server.tokens["admin"])
        entries = audit.list_latest(session, 9)
        assert admin is not None and {entry.actor for entry in entries} == {f"admin:{admin.id}"}
        assert [entry.action for entry in reversed(entries)] == [
            "team-created", "team-hidden", "token-issued", "token-revoked",
            "team-created", "token-issued", "team-hidden", "token-issued", "token-revoked",
        ]  # fmt: skip
