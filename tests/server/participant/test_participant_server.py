"""The participants' client and the real server understand each other."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from testing.api_app import Server
from testing.archive_samples import GOOD, packed, written
from testing.store_samples import NOON, PHASE

from mdrive_sumo.core.errors import InputError
from server.enums import ChallengeTrack, SubmissionState
from server.participant.client import ChallengeClient, SubmissionForm
from server.participant.follow import follow
from server.store import phases, submissions

ENTRY = SubmissionForm("dev", ChallengeTrack.SINGLE, "Mine")


@pytest.fixture
def server(tmp_path: Path) -> Server:
    return Server(tmp_path / "data")


@pytest.fixture
def team(server: Server) -> Iterator[ChallengeClient]:
    transport = server.client._transport  # Starlette's test client is one of httpx with a transport of its own
    with ChallengeClient("http://testserver", server.tokens["red"], transport) as client:
        yield client


def test_a_submission_is_sent_and_followed_to_its_end(server: Server, team: ChallengeClient, tmp_path: Path) -> None:
    told: list[int] = []
    archive = written(tmp_path, packed(GOOD))
    sent = team.submit(archive, ENTRY, told.append)
    assert (sent["state"], sent["track"], sent["name"], sent["phase"]) == ("queued", "single-agent", "Mine", "dev")
    assert sent["queue"]["position"] == 1
    assert told[-1] == archive.stat().st_size
    with server.store.write() as session:
        submissions.reject(session, sent["id"], "no camera here", NOON)
    said: list[str] = []
    assert follow(team, sent["id"], said.append) is SubmissionState.REJECTED
    assert said == ["queued", "rejected: no camera here"]


def test_the_open_public_phase_is_found_and_a_hidden_one_never_taken(server: Server, team: ChallengeClient) -> None:
    assert team.open_phase() == "dev"
    with server.store.write() as session:
        phases.set_phases(session, [replace(PHASE, closes_us=1)], NOON)
    with pytest.raises(InputError, match=r"expected --phase, one of: test \(hidden\)$"):
        team.open_phase()


def test_refusals_come_as_the_servers_sentences(server: Server, team: ChallengeClient, tmp_path: Path) -> None:
    archive = written(tmp_path, packed(GOOD))
    with pytest.raises(InputError, match=r"\(409\): .*past"):
        team.submit(archive, SubmissionForm("past", ChallengeTrack.SINGLE, "Mine"), lambda _: None)
    with pytest.raises(InputError, match=r"\(422\): track joint: expected one agent for all CAVs"):
        team.submit(archive, SubmissionForm("dev", ChallengeTrack.JOINT, "Mine"), lambda _: None)
    with pytest.raises(InputError, match=r"\(404\)"):
        team.show("0" * 32)
    written(tmp_path, packed({"agents.py": b""}))
    with pytest.raises(InputError, match=r"\(422\): archive: expected model_env.yaml"):
        team.submit(archive, ENTRY, lambda _: None)
    with (
        ChallengeClient("http://testserver", "wrong", server.client._transport) as stranger,
        pytest.raises(InputError, match=r"\(401\)"),
    ):
        stranger.submit(archive, ENTRY, lambda _: None)
