"""`study agreements`: when an agreement is consistent, by hand, and bad input."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from testing.score_golden import actor, ego, episode, scenario

from mdrive_sumo.cli.study_agreements import agreements_command
from mdrive_sumo.contract import Note
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import End
from mdrive_sumo.core.tables import format_csv
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.episode.episode import NoteRecord
from mdrive_sumo.study.agreements import RunAgreements, build_agreement_table, list_agreements
from mdrive_sumo.v2x.channel import SentMessage
from mdrive_sumo.v2x.messages import Direction, Intention, Mcm, ReferencePose, encode

TWO = scenario(ego("0"), ego("1", y=30.0))
STATIONS = {"aaaa": "0", "bbbb": "1"}
FIRST_A, FIRST_B = ("aaaa", "bbbb"), ("bbbb", "aaaa")


def outcome(tick: int, **more: object) -> NoteRecord:
    content = {"group": ["aaaa", "bbbb"], "round": 1, "by": "model", "order": list(FIRST_A)} | more
    return NoteRecord(tick, "0", Note("negotiation", json.dumps(content)))


def answer(tick: int, order: tuple[str, ...] = FIRST_A, accepted: bool = True) -> SentMessage:
    pose = ReferencePose(0.0, 30.0, 0.0, tick)
    mcm = Mcm(
        pose, 5.0, Intention.KEEP, Direction.FOLLOW, 0.2, np.zeros((0, 2)), answers={"aaaa": accepted}, group=order
    )
    return SentMessage(replace(encode(mcm), sender="1", tick=tick), {})


def drive(*said: SentMessage | NoteRecord, last: int = 60) -> EpisodeRecord:
    rows = {name: [(tick / 4, y, 0.0, 5.0) for tick in range(61)] for name, y in (("0", 0.0), ("1", 30.0))}
    rows["1"] = rows["1"][: last + 1]
    recorded = episode(TWO, rows, {"0": End.ARRIVED, "1": End.ARRIVED}, actors=actor(20.0, 3.0))
    messages = tuple(one for one in said if isinstance(one, SentMessage))
    notes = tuple(one for one in said if isinstance(one, NoteRecord))
    return replace(recorded, messages=messages, notes=notes, pseudonyms=STATIONS)


@pytest.mark.parametrize(
    ("answers", "is_consistent"),
    [
        ((answer(12),), True),
        ((answer(12, accepted=False),), False),
        ((answer(12, accepted=False), answer(20)), True),  # asked again
        ((answer(12), answer(28, FIRST_B)), False),  # holds another order by then
        ((answer(12, FIRST_B),), False),
        ((answer(10), answer(31)), False),  # too early, too late
        ((), False),
    ],
)
def test_an_agreement_is_consistent_if_all_hold_its_order_a_second_later(
    answers: tuple[SentMessage, ...], is_consistent: bool
) -> None:
    (agreement,) = list_agreements(drive(outcome(10), *answers))
    assert agreement.is_consistent is is_consistent
    assert (agreement.source, agreement.order, agreement.background) == ("0", ("0", "1"), 1)


def test_the_last_round_and_what_came_of_a_refusal_count() -> None:
    first = outcome(4, order=list(FIRST_B)), outcome(10, round=2)
    (agreement,) = list_agreements(drive(*first, answer(12)))
    assert (agreement.tick, agreement.rounds, agreement.is_consistent) == (10, 2, True)
    refused = outcome(14, by="refusal", order=list(FIRST_B), refused=["bbbb"])
    del_round = replace(refused, note=Note("negotiation", refused.note.text.replace('"round": 1, ', "")))
    (agreement,) = list_agreements(drive(*first, answer(12, accepted=False), del_round, answer(20, FIRST_B)))
    assert (agreement.tick, agreement.rounds, agreement.has_refusal, agreement.is_consistent) == (14, 2, True, True)
    assert len(list_agreements(drive(outcome(4), outcome(30)))) == 2


def test_what_has_no_order_is_not_consistent_and_who_has_ended_is_not_asked() -> None:
    ruled = outcome(10, by="rule")
    no_order = replace(ruled, note=Note("negotiation", ruled.note.text.replace('"order"', '"actions"')))
    (agreement,) = list_agreements(drive(no_order, answer(12)))
    assert not agreement.is_consistent
    assert list_agreements(drive(outcome(10), answer(12), last=29)) == []


@pytest.mark.parametrize(
    "text", ["[[", "{}", '{"group": 3, "by": "model"}', '{"group": ["c"], "by": "x", "round": "1"}']
)
def test_notes_of_other_negotiators_are_no_agreements(text: str) -> None:
    assert list_agreements(drive(NoteRecord(3, "0", Note("negotiation", text)))) == []
    assert list_agreements(drive(outcome(3, group=["cccc", "aaaa"]))) == []


def test_rows_are_by_parties_and_by_background() -> None:
    (agreement,) = list_agreements(drive(outcome(10), answer(12)))
    alone = replace(agreement, background=0, group=("0", "1", "2"))
    many = replace(agreement, background=21, held_by=("0",))
    run = RunAgreements("r", (agreement, alone, many), tuple(("p", "s", i) for i in range(3)), (40, 60), 1)
    rows = [line.split(",") for line in format_csv(build_agreement_table([run])).splitlines()[1:]]
    assert [(row[1], row[2], row[3]) for row in rows] == [
        ("all", "3", "33.333333"),
        ("2 parties", "2", "50"),
        ("3 parties", "1", "0"),
        ("1 to 20 vehicles", "1", "100"),
        ("alone on the road", "1", "0"),
        ("more than 20", "1", "0"),
    ]
    assert rows[0][-3:] == ["50", "60", "1"]


def test_a_folder_that_is_no_run_is_one_sentence(tmp_path: Path) -> None:
    done = CliRunner().invoke(agreements_command, [str(tmp_path / "none")], standalone_mode=False)
    assert isinstance(done.exception, InputError)
    assert "\n" not in str(done.exception)
