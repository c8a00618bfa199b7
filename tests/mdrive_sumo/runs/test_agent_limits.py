"""`--agent-limits`: what it accepts, that it is part of a run's identity, and that failures name limit and option."""

import io
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.agent_process.agent_connection import AgentLimits
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.report.progress import ProgressDisplay
from mdrive_sumo.runs.agent_spec import LOCAL_LIMITS, SHORTEST_S, AgentSpec, format_agent_limits, parse_agent_limits
from mdrive_sumo.runs.executor import run_jobs
from mdrive_sumo.runs.other_agents import OtherAgents
from mdrive_sumo.runs.run_config import RunConfig

SLOW = "start=600,tick=30,episode=7200"
MINE = AgentSpec("mine.py:Mine")


@given(st.tuples(*(st.floats(SHORTEST_S, 600_000.0) for _ in range(3))))
def test_the_written_form_is_read_back(times: tuple[float, float, float]) -> None:
    start_s, *rest = times
    limits = replace(LOCAL_LIMITS, start_s=start_s, tick_s=min(rest), episode_s=max(rest))
    text = format_agent_limits(limits)
    assert (parse_agent_limits(text) if text else LOCAL_LIMITS) == limits


def test_what_is_not_named_keeps_its_default() -> None:
    assert parse_agent_limits(" tick = 7.5 ") == replace(LOCAL_LIMITS, tick_s=7.5)
    assert parse_agent_limits({"episode": 7200, "tick": 30, "start": 600}) == parse_agent_limits(SLOW)
    assert format_agent_limits(parse_agent_limits("start=60,tick=5")) == ""


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "expected start=SECONDS,tick=SECONDS,episode=SECONDS, found ''"),
        ("30", "found '30'"),
        ("tick=30,", "found 'tick=30,'"),
        ("tik=30", "expected one of start, tick, episode, found 'tik'; did you mean 'tick'?"),
        ("tick=1,tick=2", "tick: expected it once, found it twice"),
        ("tick=", "tick: expected 0.01 to 604800 seconds, found ''"),
        ("tick=nan", "found 'nan'"),
        ("tick=inf", "found 'inf'"),
        ("tick=-1", "found '-1'"),
        ("tick=0", "found '0'"),
        ("tick=1e9", "found '1e9'"),
        ("tick=30s", "found '30s'"),
        ("tick=601", "episode: expected at least the 601 s of a tick, found 600 s; add episode=SECONDS"),
    ],
)
def test_bad_input_gets_a_sentence(text: str, sentence: str) -> None:
    with pytest.raises(InputError, match="--agent-limits") as caught:
        parse_agent_limits(text)
    assert sentence in str(caught.value)


def test_only_limits_that_are_not_the_defaults_are_part_of_a_run() -> None:
    usual, slow = RunConfig(agent=MINE), RunConfig(agent=MINE).with_agent_limits(parse_agent_limits(SLOW))
    assert "agent_limits" not in usual.to_dict()
    assert slow.to_dict()["agent_limits"] == SLOW
    read = RunConfig.from_dict(slow.to_dict())
    assert read.agent.limits == parse_agent_limits(SLOW)
    assert RunConfig.from_dict(usual.to_dict()).agent.limits == LOCAL_LIMITS
    assert usual.default_folder("mdrive") != slow.default_folder("mdrive")


def test_both_agents_of_a_run_have_the_limits() -> None:
    config = RunConfig(agent=AgentSpec("idm"), others=OtherAgents(MINE)).with_agent_limits(parse_agent_limits(SLOW))
    read = RunConfig.from_dict(config.to_dict())
    assert read.others is not None
    assert read.others.agent.limits == parse_agent_limits(SLOW)


def test_a_built_in_agent_has_no_limits() -> None:
    with pytest.raises(InputError, match="--agent-limits: expected an agent of a file or module, found idm, which is"):
        RunConfig().with_agent_limits(parse_agent_limits(SLOW))


def test_a_failure_names_the_option_only_where_there_is_one() -> None:
    assert AgentLimits(tick_s=3.0).describe_time("tick") == "the time limit tick (3 s)"
    text = LOCAL_LIMITS.describe_time("start")
    assert text == "the time limit start (60 s); --agent-limits start=SECONDS changes it"


class SlowExecutor:
    """One job at a time, which finishes when it was waited for twice."""

    def __init__(self) -> None:
        self.key, self.waits = "", 0

    @property
    def free_slots(self) -> int:
        return 0 if self.key else 1

    def submit(self, key: str, job: str) -> None:
        self.key, self.waits = key, 0

    def collect_outcomes(self, timeout_s: float | None = None, also: object = ()) -> list[tuple[str, str]]:
        assert timeout_s is not None
        self.waits += 1
        if self.waits <= 2:
            return []
        key, self.key = self.key, ""
        return [(key, "done")]

    def cancel(self, key: str) -> None: ...


def test_running_jobs_are_reported_while_none_finishes() -> None:
    reports: list[tuple[str, ...]] = []
    outcomes = run_jobs(SlowExecutor(), ["a", "b"], lambda running: reports.append(tuple(job for job, _ in running)))
    assert list(outcomes) == [("a", "done"), ("b", "done")]
    assert reports == [("a",), ("a",), ("b",), ("b",)]


def test_a_log_gets_a_line_a_minute() -> None:
    stream, now_s = io.StringIO(), [0.0]
    display = ProgressDisplay(stream, clock=lambda: now_s[0])
    display.begin(9, {})
    for second in range(10, 131, 10):
        now_s[0] = float(second)
        display.show_running({"i1": second, "i2": second / 2, "i3": 4.0, "i4": 3.0, "i5": 2.0})
    lines = stream.getvalue().splitlines()
    assert lines == [
        "0/9  running: i1 for 1:00, i2 for 0:30, i3 for 0:04, 2 more",
        "0/9  running: i1 for 2:00, i2 for 1:00, i3 for 0:04, 2 more",
    ]
