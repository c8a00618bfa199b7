"""`submit` sends an archive once, follows it to its end, and says what goes wrong in one sentence."""

import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from testing.archive_samples import GOOD, packed, written
from testing.participant_fakes import CLOSED, OPEN, Fake, Refusal, Run, command_line, serving

from server.enums import ChallengeTrack
from server.participant import client, follow


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> Iterator[Fake]:
    monkeypatch.setattr(follow.follow, "__defaults__", (0.0,))
    monkeypatch.setattr(client, "WAIT_S", 0.01)
    with serving(Fake()) as running:
        yield running


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Run:
    monkeypatch.chdir(tmp_path)
    return command_line(monkeypatch)


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    return written(tmp_path, packed(GOOD))


def send(run: Run, fake: Fake, archive: Path, *more: object):
    return run("submit", archive, "--server", fake.url, "--token", "secret", *more)


def test_an_archive_is_sent_with_what_belongs_to_it(run: Run, fake: Fake, archive: Path) -> None:
    fake.shown |= {"queue": {"position": 3, "eta_s": None}, "summary": None}
    found = send(run, fake, archive, "--track", "negotiation", "--name", "Mine", "--no-follow")
    assert found.exit_code == 0, found.output
    assert "submission s1 in warm-up, track negotiation: queued, position 3 in the queue" in found.output
    assert f"page: {fake.url}/submissions/s1" in found.output
    [(headers, fields)] = fake.uploads
    assert headers["Authorization"] == "Bearer secret"
    assert len(headers["Idempotency-Key"]) == 36
    assert fields == {"phase": b"warm-up", "track": b"negotiation", "name": b"Mine", "archive": archive.read_bytes()}
    assert fake.after == []


def test_a_folder_is_packed_and_named(run: Run, fake: Fake, tmp_path: Path) -> None:
    run("init-agent", "mine-1.5", "--style", "joint")
    assert send(run, fake, tmp_path / "mine-1.5", "--no-follow").exit_code == 0
    [(_, fields)] = fake.uploads
    assert (fields["name"], fields["track"], fields["archive"][:2]) == (b"mine-1.5", b"joint", b"PK")


def test_progress_reaches_the_size(fake: Fake, archive: Path) -> None:
    told: list[int] = []
    with client.ChallengeClient(fake.url, "t") as server:
        server.submit(archive, client.SubmissionForm("p", ChallengeTrack.SINGLE, "n"), told.append)
    assert told[-1] == archive.stat().st_size


def test_a_submission_is_followed_over_broken_streams(run: Run, fake: Fake, archive: Path) -> None:
    good = {"scenario": "i01", "seed": 0, "verdict": "ok", "reason": None, "ds": 98.5, "sr": 100.0}
    good |= {"efficient_sr": 50.0, "time_ratio": 1.75}
    bad = {"scenario": "i02", "seed": 0, "verdict": "agent-failed", "reason": "timeout", "ds": 3.0, "sr": 0.0}
    fake.streams = [
        [("state", {"state": "running"}), ("started", {"scenario": "i01"}), ("scenario", good)],
        [],
        [("scenario", bad), ("state", {"state": "done"})],
    ]
    fake.shown = {
        "id": "s1",
        "state": "queued",
        "summary": {"overall": {"ds": 50.75, "sr": 50.0, "rc": 77.0, "time_ratio": 2}},
    }
    fake.shown["state"] = "running"

    class Done(dict[str, Any]):
        """Done as soon as the last stream has said it."""

        def items(self) -> Any:
            return {**dict(self), "state": "done" if not fake.streams else "running"}.items()

    fake.shown = Done(fake.shown)
    found = send(run, fake, archive)
    assert found.exit_code == 0, found.output
    lines = found.output.splitlines()
    assert lines[-5:] == [
        "running",
        "ok: i01  DS  98.50  SR 100.00  efficient SR  50.00  time ratio   1.75",
        "agent-failed (timeout): i02  DS   3.00  SR   0.00",
        "done",
        "overall: DS 50.75, SR 50.00, time ratio 2.00, RC 77.00",
    ]
    assert fake.after == ["", "10", "10"]


@pytest.mark.parametrize(("away", "exit_code", "said"), [(3, 0, "done"), (4, 2, "cannot be reached")])
def test_a_server_that_is_away_is_asked_again_for_a_while(
    run: Run, fake: Fake, archive: Path, monkeypatch: pytest.MonkeyPatch, away: int, exit_code: int, said: str
) -> None:
    monkeypatch.setattr(follow, "TRIES", 3)
    fake.shown, fake.away = {"id": "s1", "state": "done"}, away
    found = send(run, fake, archive, "--phase", "warm-up")
    assert found.exit_code == exit_code, found.output
    assert said in found.output.splitlines()[-1]


@pytest.mark.slow
@pytest.mark.parametrize(("state", "exit_code"), [("rejected", 2), ("cancelled", 1), ("failed-ours", 1)])
def test_what_ended_otherwise_has_another_exit_code(
    run: Run, fake: Fake, archive: Path, state: str, exit_code: int
) -> None:
    fake.streams = []
    fake.shown = {"id": "s1", "state": state, "why": "sensor 'rgb': there is no renderer here"}
    found = send(run, fake, archive)
    assert found.exit_code == exit_code
    assert f"{state}: sensor 'rgb': there is no renderer here" in found.output


def test_an_upload_that_breaks_off_is_repeated_under_the_same_key(run: Run, fake: Fake, archive: Path) -> None:
    fake.lost = 2
    assert send(run, fake, archive, "--no-follow").exit_code == 0
    assert len(fake.uploads) == 3
    assert len({headers["Idempotency-Key"] for headers, _ in fake.uploads}) == 1
    assert {fields["archive"] for _, fields in fake.uploads} == {archive.read_bytes()}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("refusal", "expected"),
    [
        ((401, {"title": "no", "detail": "token: unknown or revoked"}, {}), "(401): token: unknown or revoked"),
        ((429, {"detail": "10 a day"}, {"Retry-After": "7200"}), "(429): 10 a day; try again in 2 h 0 min"),
        ((429, {"detail": "1 in parallel"}, {"Retry-After": "61"}), "1 in parallel; try again in 2 min"),
        ((503, {}, {"Retry-After": "0"}), "(503): Service Unavailable"),
        ((301, {}, {"Location": "https://x/"}), "(301): it has moved to https://x/"),
    ],
)
def test_refusals_are_the_servers_own_sentence(
    run: Run, fake: Fake, archive: Path, refusal: Refusal, expected: str
) -> None:
    fake.refusal = refusal
    found = send(run, fake, archive)
    assert found.exit_code == 2
    assert expected in found.output
    assert "secret" not in found.output
    assert len(fake.uploads) == (client.TRIES if "503" in expected else 1)  # that one may go by


@pytest.mark.slow
@pytest.mark.parametrize(
    ("phases", "expected"),
    [([OPEN, OPEN | {"id": "more"}], "expected --phase, one of: warm-up, more"), ([CLOSED], "none is open now")],
)
def test_the_phase_is_asked_for_unless_there_is_one(
    run: Run, fake: Fake, archive: Path, phases: list[dict[str, Any]], expected: str
) -> None:
    fake.phases = phases
    found = send(run, fake, archive)
    assert (found.exit_code, expected in found.output) == (2, True)


def test_servers_that_are_none_are_told_in_a_sentence(run: Run, fake: Fake, archive: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    for url, expected in {
        f"http://127.0.0.1:{port}": "cannot be reached",
        "ftp://x": "begins with http:// or https://",
        "http://x:y": "expected an address",
        f"{fake.url}/elsewhere": "(404): no such thing",
    }.items():
        found = run("submit", archive, "--server", url, "--token", "t")
        assert (found.exit_code, expected in found.output) == (2, True), found.output


def test_a_token_of_other_characters_is_told_without_it(run: Run, fake: Fake, archive: Path) -> None:
    for token in ("gr\u00fcn", "a\nb"):
        found = run("submit", archive, "--server", fake.url, "--token", token)
        assert found.exit_code == 2 and "token: expected the one" in found.output and token not in found.output


def test_server_and_token_are_needed(run: Run, archive: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MDRIVE_TOKEN", raising=False)
    assert "expected --server or MDRIVE_SERVER" in run("submit", archive).output
    assert "expected --token or MDRIVE_TOKEN" in run("submit", archive, "--server", "http://x").output


def test_a_bad_archive_is_not_sent(run: Run, fake: Fake, tmp_path: Path) -> None:
    found = send(run, fake, written(tmp_path, packed({"agents.py": b""})))
    assert (found.exit_code, fake.uploads) == (2, [])


def test_how_large_an_archive_may_be_is_the_servers_to_say(run: Run, fake: Fake, tmp_path: Path) -> None:
    large = written(tmp_path, packed(dict(GOOD) | {"weights/x": bytes(2**21)}))
    assert "200 times its size" in run("check", large).output
    assert send(run, fake, large, "--no-follow").exit_code == 0
    assert len(fake.uploads) == 1


def test_a_track_that_the_style_may_not_be_in_is_not_sent(run: Run, fake: Fake, archive: Path) -> None:
    found = send(run, fake, archive, "--track", "joint")
    assert (found.exit_code, fake.uploads) == (2, [])
    assert "track joint: expected one agent for all CAVs" in found.output
