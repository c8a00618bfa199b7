"""Requests made up from the OpenAPI description: whatever comes, the answer is one that the description promises."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import requests
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from testing import databases
from testing.api_app import API, Server, another_zip, listening, problem
from testing.sampling import sampled
from testing.store_samples import GOOD, LEASE, S, summary

from server.store import jobs, submissions

pytestmark = pytest.mark.filterwarnings("ignore")  # schemathesis' own, about what it could not make up
EXAMPLES = {"phase": "dev", "scenario": "left-turn", "seed": "0", "cav": "cav-1", "name": "red", "team": "red"}
WHO = ("admin", "red", "worker", "")


def furnished(folder: Path, backend: str) -> Server:
    """With submissions to be found, none of them running: a stream of events would go on."""
    server = Server(folder, databases.emptied(backend))
    ids = [server.send(data=another_zip(number)).json()["id"] for number in range(2)]
    with server.store.write() as session:
        while (job := jobs.claim(session, "w", LEASE, server.now_us)) is not None:
            jobs.finish(session, job.id, "w", job.attempt, GOOD, server.now_us + S)
        for each in ids:
            submissions.finish_if_complete(session, each, summary(80.0), server.now_us + S)
    return server


def tried(server: Server, address: str, examples: int) -> dict[str, list[int]]:
    """Calls every operation with made-up requests, half of them wrong on purpose; the statuses of each."""
    import schemathesis
    from schemathesis.core.result import Ok

    schema = schemathesis.openapi.from_dict(server.app.openapi())
    rules = settings(
        max_examples=examples,
        deadline=None,
        database=None,
        derandomize=True,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    statuses: dict[str, list[int]] = {}
    with requests.Session() as session:
        for found in schema.get_all_operations():
            assert isinstance(found, Ok)
            operation = found.ok()
            statuses[operation.label] = []
            call = caller(server, address, session, statuses[operation.label], 2 * len(statuses))
            rules(given(st.one_of([operation.as_strategy(mode) for mode in schemathesis.GenerationMode]))(call))()
    return statuses


def load_checks() -> list[Any]:
    """What schemathesis looks at in every answer; it is imported late, for it takes half a second."""
    import schemathesis.checks

    schemathesis.checks.load_all_checks()
    return schemathesis.checks.CHECKS.get_by_names(
        [
            "not_a_server_error",
            "status_code_conformance",
            "content_type_conformance",
            "response_schema_conformance",
            "response_headers_conformance",
            "allow_header_conformance",
            "unsupported_method",
            "negative_data_rejection",
        ]
    )


def caller(
    server: Server, address: str, session: requests.Session, told: list[int], first: int
) -> Callable[[Any], None]:
    """Send a case as each kind of caller in turn, beginning with one of them, and check the answer."""
    found = server.get("/submissions", "admin")["items"]
    checks = load_checks()
    known = [each["id"] for each in found if each["finished"]]  # those that admins rerun would stream events for ever

    def call(case: Any) -> None:
        who = WHO[(first + len(told)) % len(WHO)]
        if case.path_parameters and "submission" in case.path_parameters and len(told) % 3:
            case.path_parameters["submission"] = known[len(told) % len(known)]
        headers = {"Authorization": f"Bearer {server.tokens[who]}"} if who else {}
        response = case.call(base_url=address, session=session, headers=headers)
        told.append(response.status_code)
        case.validate_response(response, checks=checks)

    return call


@pytest.mark.slow
@pytest.mark.parametrize("backend", sampled(databases.BACKENDS, ("sqlite",)))
def test_made_up_requests_get_the_answers_that_are_described(tmp_path: Path, backend: str) -> None:
    """Of each operation two requests, of two callers; the next operation is called by the other two."""
    run(furnished(tmp_path, backend), 2)


@pytest.mark.full
@pytest.mark.parametrize("backend", databases.BACKENDS)
def test_very_many_made_up_requests(tmp_path: Path, backend: str) -> None:
    run(furnished(tmp_path, backend), 150)


def run(server: Server, examples: int) -> None:
    with listening(server) as address:
        statuses = tried(server, address, examples)
    assert len(statuses) == len(operations(server))
    succeeded = {label for label, told in statuses.items() if any(status < 300 for status in told)}
    assert {"GET /api/v1/health", "GET /api/v1/phases", "GET /api/v1/teams"} <= succeeded, statuses


def operations(server: Server) -> list[str]:
    return [f"{method} {path}" for path, methods in server.app.openapi()["paths"].items() for method in methods]


def test_other_methods_are_refused_with_those_that_exist(server: Server) -> None:
    """RFC 9110, 15.5.6: a 405 names the methods of the path; it named those of one route."""
    for path, methods in server.app.openapi()["paths"].items():
        known = {method.upper() for method in methods}
        example = re.sub(r"\{(\w+)\}", lambda found: EXAMPLES.get(found[1], "0" * 32), path)
        for method in {"GET", "POST", "PUT", "DELETE", "PATCH", "TRACE", "OPTIONS"} - known:
            answer = problem(server.ask(method, example.removeprefix(API), "admin"), 405)
            assert "this method is not offered here" in answer["detail"]
        allowed = set(server.ask("PATCH", example.removeprefix(API)).headers["allow"].split(", "))
        assert allowed - {"HEAD"} == known, path
        assert ("HEAD" in allowed) == ("GET" in known and not path.endswith("/events"))


@pytest.mark.parametrize(
    ("method", "path", "body", "says"),
    [
        ("PUT", "/teams/red/hidden", {"hidden": 0}, "body hidden: expected a valid boolean, found 0"),
        ("PUT", "/teams/red/hidden", {"hidden": "no"}, "body hidden: expected a valid boolean, found 'no'"),
        ("PUT", f"/submissions/{'0' * 32}/shown", {"shown": 1}, "body shown: expected a valid boolean, found 1"),
        ("POST", "/tokens", {"scope": "submit", "team": None}, "scope submit expects a team"),
    ],
)
def test_what_the_description_excludes_is_refused(
    server: Server, method: str, path: str, body: dict[str, Any], says: str
) -> None:
    problem(server.ask(method, path, "admin", json=body), 422, says)


def test_every_operation_is_described_with_its_problems(tmp_path: Path) -> None:
    """No answer that the framework adds by itself, and a problem for everything that may be refused."""
    description = Server(tmp_path).app.openapi()
    assert all(path.startswith(API) for path in description["paths"])
    assert "HTTPValidationError" not in description["components"]["schemas"]
    for methods in description["paths"].values():
        for operation in methods.values():
            assert "503" in operation["responses"] and operation["summary"] and operation["description"]
            if "security" in operation:
                assert "401" in operation["responses"]
            for status, response in operation["responses"].items():
                assert status < "400" or "application/problem+json" in response["content"]
