"""Teams, tokens, phases, events and the audit log, on both databases."""

from dataclasses import replace

import pytest
from sqlalchemy import text
from testing import databases
from testing.store_samples import NOON, PHASE, S, all_of, sent, with_teams

from mdrive_sumo.core.errors import InputError
from server.enums import TokenScope
from server.store import NotFound, NotNow, Store, audit, phases, submissions, teams, tokens
from server.store.tables import AuditEntryRow, TokenRow


@pytest.fixture(params=databases.BACKENDS)
def store(request: pytest.FixtureRequest) -> Store:
    return databases.emptied(request.param)


def test_a_team_is_found_by_name_and_id(store: Store) -> None:
    with store.write() as session:
        made = teams.create(session, "  Red Team ", NOON)
        assert made.name == "Red Team"
        assert teams.get(session, "Red Team") is made
        assert teams.get(session, made.id) is made
        with pytest.raises(NotFound, match="'Blue Team'"):
            teams.get(session, "Blue Team")


@pytest.mark.parametrize("name", ["", "   ", "a\x00b", "line\nbreak", "x" * 65])
def test_unusable_names_are_refused_in_one_sentence(store: Store, name: str) -> None:
    with pytest.raises(InputError, match="name of a team: expected 1 to 64 printable"), store.write() as session:
        teams.create(session, name, NOON)


def test_a_name_is_taken_once(store: Store) -> None:
    with pytest.raises(InputError, match="'red' is taken"), store.write() as session:
        teams.create(session, "red", NOON)
        teams.create(session, "red", NOON)


def test_a_token_is_held_until_revoked_and_stored_as_hash_only(store: Store) -> None:
    with_teams(store, "red")
    with store.write() as session:
        red = teams.get(session, "red")
        first, second = (tokens.issue(session, red, TokenScope.SUBMIT, NOON) for _ in range(2))
    with store.write() as session:
        held = tokens.find_token(session, first)
        assert held is not None and (held.team, held.scope) == (red.id, "submit")
        tokens.revoke(session, held.id, NOON + 1)
        tokens.revoke(session, held.id, NOON + 2)
        assert held.revoked_us == NOON + 1
    with store.read() as session:
        assert tokens.find_token(session, first) is None
        assert tokens.find_token(session, second) is not None
        assert len(tokens.list_tokens(session, red)) == 2
        rows = str(
            [vars(token) for token in all_of(session, TokenRow)]
            + [vars(entry) for entry in all_of(session, AuditEntryRow)]
        )
        assert first not in rows and first.removeprefix(tokens.PREFIX) not in rows
    assert len(first) >= 43 and first != second


@pytest.mark.parametrize("guess", ["", "mdrive_", "no token", "\ud800", "x" * 10_000, "a\x00b"])
def test_a_token_that_was_never_issued_has_no_holder(store: Store, guess: str) -> None:
    with store.read() as session:
        assert tokens.find_token(session, guess) is None


def test_a_hash_from_the_database_is_no_token(store: Store) -> None:
    with store.write() as session:
        tokens.issue(session, None, TokenScope.ADMIN, NOON)
        (row,) = all_of(session, TokenRow)
        assert tokens.find_token(session, row.hash) is None


def test_scope_and_team_fit(store: Store) -> None:
    with_teams(store, "red")
    with store.write() as session:
        for scope in (TokenScope.ADMIN, TokenScope.WORKER):
            with pytest.raises(InputError, match="expects no team"):
                tokens.issue(session, teams.get(session, "red"), scope, NOON)
        with pytest.raises(InputError, match="expects a team"):
            tokens.issue(session, None, TokenScope.SUBMIT, NOON)
        with pytest.raises(NotFound):
            tokens.revoke(session, "nobody's", NOON)


def test_phases_follow_the_settings(store: Store) -> None:
    with store.write() as session:
        phases.set_phases(session, [PHASE, replace(PHASE, id="test", opens_us=5)], NOON)
        phases.set_phases(session, [replace(PHASE, per_day=7)], NOON)
        assert [(phase.id, phase.per_day) for phase in phases.list_phases(session)] == [("dev", 7), ("test", 3)]
        phases.set_phases(session, [replace(PHASE, per_day=7)], NOON)  # nothing new: nothing to note
        assert audit.verify_chain(session).entries == 3
        with pytest.raises(NotFound, match="expected one of dev, test, found 'final'"):
            phases.get(session, "final")


def test_a_phase_is_open_from_its_start_to_before_its_end(store: Store) -> None:
    (red,) = with_teams(store, "red", phase=replace(PHASE, opens_us=NOON, closes_us=NOON + S))
    with store.write() as session:
        with pytest.raises(NotNow, match=r"phase dev: it opens at 2024-10-04 12:00:00 UTC"):
            sent(session, red, NOON - 1)
        assert sent(session, red, NOON).phase == "dev"
        with pytest.raises(NotNow, match=r"closed at 2024-10-04 12:00:01 UTC"):
            sent(session, red, NOON + S)


def test_events_are_replayed_from_any_id_on(store: Store) -> None:
    (red,) = with_teams(store, "red")
    with store.write() as session:
        submission = sent(session, red).id
        for number in range(3):
            submissions.add_event(session, submission, "note", {"number": number}, NOON)
    with store.read() as session:
        first, *rest = submissions.list_events(session, submission)
        assert (first.kind, first.data) == ("state", {"state": "queued"})
        assert [event.data["number"] for event in submissions.list_events(session, submission, rest[0].id)] == [1, 2]
        assert len(submissions.list_events(session, submission, limit=2)) == 2
        assert submissions.list_events(session, "another") == []


def test_the_audit_chain_shows_every_change(store: Store) -> None:
    with store.write() as session:
        for number in range(4):
            audit.add_entry(session, "admin", "tested", {"umlaut": "ä", "number": number, "float": 0.1}, NOON + number)
    with store.read() as session:
        whole = audit.verify_chain(session)
        assert (whole.entries, whole.broken, whole.head) == (4, None, audit.find_head(session))
        second = all_of(session, AuditEntryRow)[1].id
    changes = ("at_us = at_us + 1", "actor = 'nobody'", "action = 'undone'", "data = '{}'", "hash = 'x'")
    for change in changes:
        with pytest.raises(_Undo), store.write() as session:
            session.execute(text(f"UPDATE audit SET {change} WHERE id = {second}"))
            assert audit.verify_chain(session).broken == second
            raise _Undo
    with store.write() as session:
        session.execute(text(f"DELETE FROM audit WHERE id = {second}"))
        assert audit.verify_chain(session).broken == second + 1


def test_spot_checks_that_differ_are_counted(store: Store) -> None:
    with store.write() as session:
        for deed, same in (("spot-check", True), ("spot-check", False), ("tested", False)):
            audit.add_entry(session, "server", deed, {"same": same}, NOON)
        assert audit.count_spot_check_differences(session) == 1
        assert [entry.action for entry in audit.list_latest(session, 2)] == ["tested", "spot-check"]
        assert [entry.data["same"] for entry in audit.list_latest(session, 5, "spot-check")] == [False, True]


def test_an_audit_cut_at_its_end_shows_against_a_noted_head(store: Store) -> None:
    with store.write() as session:
        for number in range(2):
            audit.add_entry(session, "admin", "tested", {"number": number}, NOON)
        noted = audit.find_head(session)
        session.execute(text("DELETE FROM audit WHERE id = (SELECT max(id) FROM audit)"))
        found = audit.verify_chain(session)
        assert found.broken is None and found.head != noted


class _Undo(Exception):
    """Rolls a change back."""
