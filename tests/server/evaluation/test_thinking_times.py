"""Agents that answer early or late are flagged to organisers, and to nobody else."""

import json
import random
from pathlib import Path
from typing import Any

import pytest
from testing.api_app import Server
from testing.store_samples import GOOD, LEASE, S, summary
from testing.web_page import Visit

from mdrive_sumo.core.bimodality import describe_modes
from server.enums import ScenarioVerdict
from server.evaluation.submission_job import collect_usage
from server.evaluation.summary import write_summary
from server.evaluation.thinking_times import FLAG_ACTION, THINKING, find_thinking_flag
from server.store import audit, jobs
from server.store.jobs import JobOutcome
from server.store.overviews import make_overview


def times_of(levels_s: tuple[float, ...], late: int | None = None) -> dict[str, Any]:
    random_ = random.Random(1)
    times = [random_.choice(levels_s) + random_.uniform(0.001, 0.002) for _ in range(200)]
    return {"modes": describe_modes(times), "late": late}


def usage_of(**agents: dict[str, Any]) -> dict[str, Any]:
    return {"cpu_s": 1.0, "boxes": {}, THINKING: agents}


HONEST, SENDER = times_of((0.0,), late=0), times_of((0.0, 0.05), late=97)


def test_only_a_sender_is_flagged() -> None:
    assert find_thinking_flag([usage_of(a=HONEST, b=HONEST), None, {"cpu_s": 1.0}, usage_of()]) is None
    flag = find_thinking_flag([usage_of(a=HONEST, b=SENDER), usage_of(a=HONEST), None])
    assert flag is not None and (flag.agents, flag.bimodal, flag.late) == (3, 1, 97)
    assert flag.text.startswith("1 of 3 agents answer in two groups of times; the widest are 1.4")
    assert flag.text.endswith("; 97 answers took longer than the pace")


def test_late_answers_alone_are_a_flag() -> None:
    flag = find_thinking_flag([usage_of(a={**HONEST, "late": 3})])
    assert (
        flag is not None
        and flag.text == "0 of 1 agents answer in two groups of times; 3 answers took longer than the pace"
    )


def test_the_record_of_a_box_becomes_a_part_of_the_usage(tmp_path: Path) -> None:
    thought = {"p50": 1.0, "p99": 2.0, "max": 3.0, "sum": 4.0, "counts": [1, 2]}
    for name, more in (("one.0.json", SENDER), ("one.1.json", {})):  # records of an older version have none
        (tmp_path / name).write_text(
            json.dumps({"thought_ms": {**thought, **more}, "answers": 3, "backend": "bubblewrap"})
        )
    found = collect_usage(tmp_path)
    assert found[THINKING] == {"0": SENDER, "1": {"modes": None, "late": None}}


def test_lists_do_not_show_it() -> None:
    assert make_overview(GOOD.result, usage_of(a=SENDER))["usage"] == {"cpu_s": 1.0, "boxes": {}}


@pytest.mark.slow
def test_organisers_see_it_and_teams_do_not(tmp_path: Path) -> None:
    server = Server(tmp_path)
    mine = server.send().json()["id"]
    outcome = JobOutcome(ScenarioVerdict.OK, GOOD.result, None, usage_of(a=SENDER))
    with server.store.write() as session:
        while (job := jobs.claim(session, "w", LEASE, server.now_us)) is not None:
            jobs.finish(session, job.id, "w", job.attempt, outcome, server.now_us + S)
    drawn: list[str] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("server.evaluation.summary.summarise", lambda _: summary(80.0))
        write_summary(server.store, mine, lambda: server.now_us + S, lambda _, name: drawn.append(name))
    with server.store.read() as session:
        (entry,) = audit.list_latest(session, 10, FLAG_ACTION)
        assert (
            entry.data["submission"] == mine
            and entry.data["bimodal"] == 2
            and audit.verify_chain(session).broken is None
        )
    assert "2 of 2" in Visit(server, "admin").get("/admin").words
    for path in ("", "/scenarios", "/scenarios.csv", "/events"):
        text = server.ask("GET", f"/submissions/{mine}{path}", "red").text
        assert text and "thinking" not in text and "modes" not in text
    assert "No flagged submissions." not in Visit(server, "admin").get("/admin").words
    assert server.get("/audit", "admin")["differences"] == []
