"""Studies: conditions, intervals, captured cooperation, sweeps over the channel, and the value of a message."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from hypothesis import given
from hypothesis import strategies as st
from testing.paths import TESTS

from mdrive_sumo.cli import main
from mdrive_sumo.contract import Control, Message
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import Actors, EgoState, End, Frame
from mdrive_sumo.episode import Ending, EpisodeRecord, Recorder, load_episode, quantize_frame
from mdrive_sumo.report.result_tables import format_summary
from mdrive_sumo.report.run_report import build_run_report
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.scoring import Results, RunInfo, ScenarioResult, ScoreMode, load_results, summarize_run
from mdrive_sumo.study.ablation import MuteEffect, choose_mutes, find_divergence_tick, rank_effects
from mdrive_sumo.study.captured_cooperation import (
    LEAST_GAIN_DS,
    compute_captured_cooperation,
    compute_captured_from_scenarios,
    compute_captured_share,
)
from mdrive_sumo.study.conditions import (
    FACTORS,
    ChannelCondition,
    make_conditions,
    parse_levels,
    parse_pose_levels,
)
from mdrive_sumo.study.plots import draw_curves, make_curves
from mdrive_sumo.study.study_runs import StudyRow, is_silent, name_agent_folder
from mdrive_sumo.study.study_summary import (
    StudyLine,
    compute_difference_interval,
    compute_score_interval,
    group_by_scenario,
    summarise_rows,
)
from mdrive_sumo.v2x.channel import DeliveryStatus, SentMessage
from mdrive_sumo.v2x.comm_settings import PRESETS, CommSettings, LinkSettings, format_comm_json

FAKE_MAIN = [sys.executable, "-c", "from testing import study_fakes; study_fakes.main()"]
TALKER = str(TESTS / "testing" / "study_talker.py") + ":Talker"
IDEAL, OFF = PRESETS["ideal"], PRESETS["off"]


# ----------------------------------------------------------------------------------------------- hand-made results


def scenario(name: str, ds: float, seed: int = 0, **other: object) -> ScenarioResult:
    values = {
        "id": name,
        "bucket": "InterDrive",
        "category": "ins_c",
        "seed": seed,
        "status": "ok",
        "reason": "",
        "ds": ds,
        "sr": ds,
        "rc": ds,
        "ip": 1.0,
        "min_ttc": None,
        "digest": "",
        "ticks": 1,
        "egos": [],
    }
    return ScenarioResult.model_validate(values | other)


def run(*scenarios: ScenarioResult, **facts: object) -> Results:
    about = {
        "agent": "talker",
        "suite": "interdrive",
        "suite_checksum": "sha256:0",
        "seed": scenarios[0].seed,
        "score_mode": "mdrive",
        "versions": {},
    }
    return summarize_run(RunInfo.model_validate(about | facts), scenarios)


def row(agent: str, condition: ChannelCondition, *scenarios: ScenarioResult, reused: bool = False) -> StudyRow:
    return StudyRow(agent, condition, (run(*scenarios, agent=agent),), reused)


# ----------------------------------------------------------------------------------------------------- conditions


def test_one_factor_at_a_time_leaves_the_others_at_the_base() -> None:
    varied = {"latency": parse_levels("latency", "0,2,6"), "pose-error": parse_pose_levels("0,0.6", None)}
    found = make_conditions(IDEAL, varied, "one-at-a-time")
    assert [c.name for c in found] == ["base", "latency 2 ticks", "latency 6 ticks", "pose-error 0.6 m 0.6°"]
    assert found[0].comm == IDEAL
    assert found[2].comm.link == LinkSettings(latency_ticks=6)
    assert found[3].comm.link == LinkSettings(pose_error_m=0.6, pose_error_deg=0.6)


def test_the_whole_grid_has_every_combination_once() -> None:
    varied = {"latency": parse_levels("latency", "0,6"), "loss": parse_levels("loss", "0,0.3,1")}
    found = make_conditions(IDEAL, varied, "full")
    links = [(c.comm.link.latency_ticks, c.comm.link.loss) for c in found]
    assert sorted(links) == [(0, 0.0), (0, 0.3), (0, 1.0), (6, 0.0), (6, 0.3), (6, 1.0)]
    assert links[0] == (0, 0.0)
    assert len({c.folder for c in found}) == len(found)


def test_a_level_holds_for_every_type_of_message_and_replaces_what_types_had() -> None:
    base = CommSettings(link=LinkSettings(loss=0.1), by_type={"cpm": LinkSettings(loss=0.5, latency_ticks=3)})
    _, even, lossy = make_conditions(base, {"loss": parse_levels("loss", "0.1,0.4")}, "one-at-a-time")
    assert even.comm.by_type == {"cpm": LinkSettings(loss=0.1, latency_ticks=3)}
    assert (lossy.comm.link.loss, lossy.comm.by_type["cpm"].loss) == (0.4, 0.4)


@given(st.lists(st.floats(0, 1), min_size=1, max_size=6, unique=True))
def test_levels_are_read_as_they_were_written_and_never_mixed_up(losses: list[float]) -> None:
    levels = parse_levels("loss", ",".join(map(repr, losses)))
    assert levels == tuple((loss,) for loss in losses)
    found = make_conditions(CommSettings(link=LinkSettings(loss=0.123)), {"loss": levels}, "one-at-a-time")
    assert {c.comm.link.loss for c in found} == {0.123, *losses}
    assert len({c.folder for c in found}) == len(found)


def test_folders_of_agents_differ_where_classes_have_one_name() -> None:
    assert name_agent_folder(AgentSpec("idm")) == "idm"
    names = [name_agent_folder(AgentSpec(f"/{folder}/x.py:Same")) for folder in "ab"]
    assert len(set(names)) == 2 and all(name.startswith("x_Same-") for name in names)


def test_differences_are_paired_and_void_scenarios_are_left_out() -> None:
    base = group_by_scenario([scenario("a", 50), scenario("b", 10), scenario("c", 0, status="void"), scenario("d", 5)])
    worse = group_by_scenario([scenario("a", 40), scenario("b", 0), scenario("c", 99), scenario("d", 0, status="void")])
    assert set(worse) == {"a", "b", "c"}
    found = compute_difference_interval(worse, base, "ds")
    assert found is not None
    assert (found.mean, found.low, found.high) == (-10.0, -10.0, -10.0)
    assert compute_score_interval(group_by_scenario([scenario("a", 0, status="void")]), "ds") is None


def test_a_scenario_that_is_void_with_one_seed_is_left_out_with_all() -> None:
    assert set(group_by_scenario([scenario("a", 1, 0), scenario("a", 1, 1, status="void"), scenario("b", 1, 0)])) == {
        "b"
    }


# ------------------------------------------------------------------------------------------- captured cooperation


def test_captured_per_bucket_category_and_overall() -> None:
    agent = run(scenario("a", 60), scenario("b", 90, bucket="Real", category="r"))
    off = run(scenario("a", 40), scenario("b", 90, bucket="Real", category="r"))
    best = run(scenario("a", 80), scenario("b", 91, bucket="Real", category="r"))
    found = compute_captured_cooperation(agent, off, best)
    assert found.buckets == {"InterDrive": 0.5, "Real": None}
    assert found.categories == {"ins_c": 0.5, "r": None, "LM": 0.5}
    assert found.bucket_mean == found.scenario_mean == pytest.approx(20 / 41)


def test_captured_leaves_out_what_is_void_in_one_of_the_runs() -> None:
    agent = run(scenario("a", 60), scenario("b", 0, status="void"), scenario("c", 100))
    off = run(scenario("a", 40), scenario("b", 100), scenario("c", 100))
    best = run(scenario("a", 80), scenario("b", 100), scenario("c", 0, status="void"))
    assert compute_captured_cooperation(agent, off, best).scenario_mean == 0.5
    with pytest.raises(InputError, match="expected scenarios that all three runs have"):
        compute_captured_cooperation(agent, off, run(scenario("z", 1)))


@pytest.mark.parametrize("fact", [{"score_mode": "interdrive_fixed"}, {"suite_checksum": "sha256:1"}])
def test_runs_that_do_not_belong_together_are_refused(fact: dict[str, str]) -> None:
    one = run(scenario("a", 60))
    with pytest.raises(InputError, match="expected runs of one"):
        compute_captured_cooperation(one, one, run(scenario("a", 80), **fact))


@given(off=st.floats(0, 98), gain=st.floats(LEAST_GAIN_DS, 100), part=st.floats(-1, 2))
def test_the_share_is_what_was_put_in(off: float, gain: float, part: float) -> None:
    found = compute_captured_share(off + part * gain, off, off + gain)
    assert found is None or found == pytest.approx(part, abs=1e-9)
    assert compute_captured_share(off, off, off + LEAST_GAIN_DS * 0.99) is None
    assert compute_captured_share(100, off, off - gain) is None


def test_seeds_are_paired_by_seed() -> None:
    agent = [scenario("a", 50, 0), scenario("a", 70, 1)]
    off = [scenario("a", 40, 0), scenario("a", 40, 1), scenario("a", 0, 2)]
    best = [scenario("a", 80, 0), scenario("a", 80, 1)]
    assert compute_captured_from_scenarios(agent, off, best, ScoreMode.MDRIVE).scenario_mean == 0.5


def test_every_table_shows_captured_cooperation_if_it_is_there() -> None:
    agent = run(scenario("a", 60), scenario("b", 90, bucket="Real", category="r"))
    off, best = (run(scenario("a", ds), scenario("b", 90, bucket="Real", category="r")) for ds in (40, 80))
    shares = compute_captured_cooperation(agent, off, best)
    table = format_summary(agent, shares).splitlines()
    assert table[2].endswith("captured [%]")
    assert table[4].split()[-1] == "50.0" and table[5].split()[-1] == "1.000"
    page = build_run_report(agent, shares)
    assert "Captured cooperation is (agent" in page
    assert "| InterDrive | 1 | 60.00 | 60.00 | 60.00 | 1.000 | 50.0 |" in page
    assert "| ins_c | 1 | 60.00 | 60.00 | 60.00 | 1.000 | 60.00 | 50.0 |" in page
    assert "aptured" not in format_summary(agent) + build_run_report(agent)


# ------------------------------------------------------------------------------------------------ lines and plots


def told() -> tuple[tuple[StudyLine, ...], ChannelCondition]:
    base, slow = make_conditions(IDEAL, {"latency": parse_levels("latency", "6")}, "one-at-a-time")
    off = ChannelCondition("off", OFF, {})
    rows = (
        row("talker", base, scenario("a", 70), scenario("b", 50)),
        row("talker", off, scenario("a", 30), scenario("b", 30)),
        row("talker", slow, scenario("a", 60), scenario("b", 40)),
        row("omniscient", base, scenario("a", 90), scenario("b", 70)),
    )
    return summarise_rows(rows), base


def test_a_line_compares_with_the_base_and_the_references() -> None:
    found, _ = told()
    base, off, slow, best = found
    assert base.ds_difference is None and base.captured and base.captured.scenario_mean == pytest.approx(0.6)
    assert off.captured and off.captured.scenario_mean == 0.0
    assert slow.ds and slow.ds.mean == 50.0
    assert slow.ds_difference and (slow.ds_difference.low, slow.ds_difference.high) == (-10.0, -10.0)
    assert slow.captured and slow.captured.scenario_mean == pytest.approx(0.4)
    assert best.captured is None


def test_curves_go_through_the_base_and_are_drawn_alike_every_time(tmp_path: Path) -> None:
    found, base = told()
    (curve,) = make_curves(found, FACTORS["latency"], base)
    assert list(curve.lines) == [(0,), (6,)]
    assert curve.off is found[1]
    assert make_curves(found, FACTORS["loss"], base) == ()
    first = [path.read_bytes() for path in draw_curves([curve], FACTORS["latency"], "title", tmp_path / "latency")]
    again = [path.read_bytes() for path in draw_curves([curve], FACTORS["latency"], "title", tmp_path / "again")]
    assert first[0].startswith(b"\x89PNG") and b"latency [ticks of 0.05 s]" not in first[0]
    assert first == again
    with pytest.raises(InputError, match="cannot be written"):
        draw_curves([curve], FACTORS["latency"], "title", tmp_path / "missing" / "latency")


def test_silence_is_only_believed_of_scenarios_that_are_not_void() -> None:
    base = ChannelCondition("base", IDEAL, {})
    assert is_silent(row("idm", base, scenario("a", 1)))
    assert not is_silent(row("idm", base, scenario("a", 1), scenario("b", 0, status="void")))
    assert not is_silent(row("idm", base, scenario("a", 1, comm={"sent": 1})))


# ------------------------------------------------------------------------------------------ sweeps, without SUMO


@pytest.fixture
def suite(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Two scenarios, and an `evaluate` that drives them without processes and without SUMO."""
    made = fake_suite(monkeypatch, tmp_path, "answer", "answer")
    from testing import study_fakes

    monkeypatch.setattr("mdrive_sumo.runs.evaluate.make_executor", study_fakes.Inline)
    monkeypatch.setattr("mdrive_sumo.runs.evaluate.run_job", study_fakes.drive)
    return made


def fake_suite(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, *deeds: str) -> Path:
    monkeypatch.syspath_prepend(str(TESTS))
    from testing import suite_fakes

    suite_fakes.make_suite(tmp_path / "suite", *deeds)
    return tmp_path / "suite"


def invoke(*given: str | Path) -> Result:
    return CliRunner().invoke(main, [str(word) for word in given])


def study(tmp_path: Path, *more: str | Path, agents: str = "stationary,idm") -> Result:
    given = ("--suite", tmp_path / "suite", "--agents", agents, "--out", tmp_path / "out", "--workers", "1")
    return invoke("study", "comm", *given, *more)


def in_a_process(tmp_path: Path) -> "subprocess.Popen[str]":
    """The same as a process of its own, with workers."""
    given = ("--suite", str(tmp_path / "suite"), "--agents", "stationary", "--out", str(tmp_path / "out"))
    command = [*FAKE_MAIN, "study", "comm", *given, "--workers", "1", "--latency", "6", "--no-captured"]
    path = os.pathsep.join((str(TESTS), os.environ.get("PYTHONPATH", "")))
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=os.environ | {"PYTHONPATH": path})


def called(suite: Path) -> list[str]:
    return (suite / "calls").read_text().splitlines() if (suite / "calls").exists() else []


SWEEP = ("--latency", "0,10", "--loss", "0.5", "--seeds", "2")


def test_one_command_makes_the_table_the_numbers_and_the_pictures(suite: Path, tmp_path: Path) -> None:
    ended = study(tmp_path, *SWEEP)
    assert ended.exit_code == 0, ended.output
    out = tmp_path / "out"
    page = json.loads((out / "study.json").read_text())
    found = {(line["agent"], line["condition"]): line for line in page["lines"]}
    assert list(found)[:4] == [("stationary", name) for name in ("base", "off", "latency 10 ticks", "loss 0.5")]
    slow = found["stationary", "latency 10 ticks"]
    assert slow["ds"]["mean"] == 60.5 and slow["ds_difference"] == {"mean": -10, "low": -10, "high": -10}
    assert slow["captured"]["scenario_mean"] == pytest.approx(0.5)
    assert slow["comm"]["latency_ticks"] == 10
    assert [one["seed"] for one in slow["runs"]] == [0, 1]
    assert found["stationary", "loss 0.5"]["sr_difference"]["mean"] == -10
    assert found["idm", "loss 0.5"]["reused"] and not found["idm", "base"]["reused"]
    table = (out / "study.md").read_text()
    assert "| latency 10 ticks | 60.5 [60.0, 61.0] | 30.2 [30.0, 30.5] | -10.0 [-10.0, -10.0] |" in table
    assert "one factor at a time" in table and "![latency](latency.png)" in table
    pictures = {f"{name}.{kind}" for name in ("latency", "loss") for kind in ("png", "svg")}
    assert {path.name for path in out.iterdir()} == {"runs", "study.json", "study.md", *pictures}
    assert load_results(out / "runs" / "stationary" / "loss_0.5" / "seed1" / "results.json").run.comm["loss"] == 0.5


def test_who_says_nothing_is_driven_once_and_finished_runs_never_again(suite: Path, tmp_path: Path) -> None:
    ended = study(tmp_path, *SWEEP)
    calls = called(suite)
    drivers = [call.split()[0] for call in calls]
    assert {name: drivers.count(name) for name in set(drivers)} == {"stationary": 16, "idm": 4, "omniscient": 4}
    assert len(set(calls)) == len(calls)
    assert "idm sends no messages: its base runs stand for all conditions" in ended.stderr
    assert "24/24" in ended.stderr.splitlines()[-1]
    before = (tmp_path / "out" / "study.json").read_bytes(), (tmp_path / "out" / "latency.svg").read_bytes()
    study(tmp_path, *SWEEP)
    assert called(suite) == calls
    assert before == ((tmp_path / "out" / "study.json").read_bytes(), (tmp_path / "out" / "latency.svg").read_bytes())
    study(tmp_path, "--latency", "0,10,20", "--loss", "0.5", "--seeds", "2")
    assert len(called(suite)) == len(calls) + 4


def test_the_references_can_be_left_out_and_omniscient_is_driven_once(suite: Path, tmp_path: Path) -> None:
    ended = study(tmp_path, "--loss", "0.5", "--no-captured", "--no-record", agents="stationary")
    assert ended.exit_code == 0, ended.output
    assert "captured [%]" not in ended.stdout + (tmp_path / "out" / "study.md").read_text()
    assert len(called(suite)) == 4
    assert not list((tmp_path / "out").rglob("episodes"))
    study(tmp_path, "--loss", "0.5", "--out", str(tmp_path / "other"), agents="omniscient")
    assert len(called(suite)) == 6


def test_the_whole_grid(suite: Path, tmp_path: Path) -> None:
    study(tmp_path, "--latency", "0,10", "--pose-error", "0,1", "--grid", "full", "--no-captured", agents="stationary")
    page = json.loads((tmp_path / "out" / "study.json").read_text())
    assert {line["condition"]: line["ds"]["mean"] for line in page["lines"]} == {
        "base": 70,
        "pose-error 1 m 1°": 60,
        "latency 10 ticks": 60,
        "latency 10 ticks, pose-error 1 m 1°": 50,
    }
    assert (tmp_path / "out" / "pose-error.png").is_file()


@pytest.mark.slow
def test_an_interrupted_study_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = fake_suite(monkeypatch, tmp_path, "answer", "hang once")
    with in_a_process(tmp_path) as process:
        end = time.monotonic() + 30
        while not (folder / "s1.started").exists() or "s0" not in "".join(called(folder)):
            assert time.monotonic() < end
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=20)
    assert process.returncode == 130
    assert errors.splitlines()[-1] == f"interrupted; the same command without --fresh continues {tmp_path / 'out'}"
    before = called(folder)
    with in_a_process(tmp_path) as process:
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 0, errors
    assert sorted(called(folder)[len(before) :]) == sorted({*called(folder)} - {before[0]})
    assert "4/4" in errors.splitlines()[-1]


@pytest.mark.slow
def test_void_scenarios_are_exit_code_1_and_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fake_suite(monkeypatch, tmp_path, "answer", "kill")
    with in_a_process(tmp_path) as process:
        process.communicate(timeout=60)
    assert process.returncode == 1
    lines = json.loads((tmp_path / "out" / "study.json").read_text())["lines"]
    assert [(line["void"], line["ds"]["mean"]) for line in lines] == [(1, 70), (1, 64)]


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        (("--latency", "-1"), "study: --latency: expected whole numbers of ticks between 0 and 10000, found '-1'"),
        (("--latency", "1.5"), "study: --latency: expected whole numbers of ticks between 0 and 10000, found '1.5'"),
        (("--loss", "0,1.1"), "study: --loss: expected numbers between 0 and 1, found '1.1'"),
        (("--loss", "nan"), "study: --loss: expected numbers between 0 and 1, found 'nan'"),
        (("--loss", ""), "study: --loss: expected numbers with commas between them, found ''"),
        (("--loss", "0,,1"), "study: --loss: expected numbers with commas between them, found ''"),
        (("--loss", "0.1,0.1"), "study: --loss: expected different values, found one twice"),
        (("--pose-error", "inf"), "study: --pose-error: expected numbers of 0 or more, found 'inf'"),
        (("--pose-error", "1,2", "--rotation-error", "1"), "study: --rotation-error: expected 2 values, as"),
        (("--rotation-error", "1"), "study: --rotation-error: expected --pose-error with it, found none"),
        ((), "study: expected at least one of --latency, --loss and --pose-error, found none"),
        (("--loss", "0", "--comm", "off"), "study: expected a base channel that is on, found --comm off"),
        (("--loss", "0", "--comm", "best"), "--comm: expected one of"),
        (("--loss", "0", "--agents", "idm,nobody"), "agent 'nobody': expected"),
        (("--loss", "0", "--agents", ""), "study: --agents: expected different agents with commas between them"),
        (("--loss", "0", "--agents", "idm,idm"), "study: --agents: expected different agents"),
        (("--loss", "0", "--agent-config", "idm"), "study: --agent-config: expected AGENT=FILE"),
        (("--loss", "0", "--agent-config", "x=y"), "study: --agent-config: expected AGENT=FILE"),
        (("--loss", "0", "--agent-clock", "slow"), "agent clock: expected"),
        (("--loss", "0", "--scenario", "zz"), "suite"),
        (("--loss", "0", "--seeds", "0"), "Invalid value for '--seeds'"),
    ],
)
def test_bad_input_is_one_sentence_before_anything_runs(
    suite: Path, tmp_path: Path, more: tuple[str, ...], sentence: str
) -> None:
    given = ["study", "comm", "--suite", str(suite), "--agents", "stationary", "--out", str(tmp_path / "out"), *more]
    ended = CliRunner().invoke(main, given)
    assert ended.exit_code == 2
    last = ended.stderr.splitlines()[-1]
    assert last.startswith(f"Error: {sentence}"), last
    assert not (tmp_path / "out").exists()


# --------------------------------------------------------------------------------------------------------- ablate


def episode(xs: list[float], ids: tuple[str, ...] = ("0", "1")) -> EpisodeRecord:
    recorder = Recorder("s", {}, dict.fromkeys(ids, (4.9, 2.0)))
    for tick, x in enumerate(xs):
        egos = {name: EgoState(x=x if name == ids[-1] else 0.0, y=0.0, yaw=0.0, speed=1.0) for name in ids}
        recorder.add(quantize_frame(Frame(tick, egos, Actors.empty(), {})), dict.fromkeys(ids, PEDAL), {}, {})
    return recorder.finish([Ending(ego, len(xs) - 1, End.ARRIVED) for ego in ids])


PEDAL = Control(throttle=0.5, brake=0.0, steer=0.0)


@given(tick=st.integers(0, 5))
def test_episodes_part_where_somebody_is_somewhere_else(tick: int) -> None:
    same = [float(i) for i in range(6)]
    moved = [x + 0.01 * (i >= tick) for i, x in enumerate(same)]
    assert find_divergence_tick(episode(same), episode(moved)) == tick
    assert find_divergence_tick(episode(same), episode(same)) is None
    assert find_divergence_tick(episode(same), episode(same[:4])) == 4
    assert find_divergence_tick(episode(same), episode(same, ("0", "2"))) == 0


def sent(sender: str, kind: str, tick: int, fate: DeliveryStatus = DeliveryStatus.DELIVERED) -> SentMessage:
    return SentMessage(Message(kind, b"", sender, tick), {"z": (fate, tick)})


SAID = (sent("0", "cam", 1), sent("1", "cpm", 1), sent("0", "cam", 2), sent("0", "cam", 2), sent("r", "cpm", 3),
        sent("0", "text", 3, DeliveryStatus.LOST))  # fmt: skip


def test_what_is_muted_without_a_wish_is_every_sender_and_every_type_that_was_heard() -> None:
    assert choose_mutes(SAID, ()) == ("0/*", "1/*", "r/*", "*/cam", "*/cpm")
    assert choose_mutes(SAID, ("0/text", "0/text", "*/*@2")) == ("0/text", "*/*@2")
    assert choose_mutes(SAID, (), "cam") == ("0/cam@1", "0/cam@2")
    assert choose_mutes(SAID, ("r/*",), "cpm") == ("r/*", "1/cpm@1", "r/cpm@3")


@pytest.mark.parametrize(
    ("choice", "sentence"),
    [
        (((), "cam", 1), "expected at most 1 runs, found 2; --max-runs 2 allows them"),
        (((), "text"), "expected a type of message that reached a receiver, found 'text'"),
        ((("9/*",),), "expected a pattern that fits a message, found '9/\\*'"),
        ((("9",),), "mute: expected SENDER/TYPE"),
    ],
)
def test_what_cannot_be_muted_is_one_sentence(choice: tuple[object, ...], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        choose_mutes(SAID, *choice)  # type: ignore[arg-type]
    for said in ((), SAID[-1:]):
        with pytest.raises(InputError, match="found no"):
            choose_mutes(said, ())


def test_the_largest_effect_comes_first() -> None:
    def effect(name: str, ds: float, ttc: float | None, parted: int | None) -> MuteEffect:
        return MuteEffect((name,), 1, scenario("a", ds, min_ttc=ttc), parted, "")

    effects = [
        effect("none", 50, 1.0, None),
        effect("late", 50, 1.0, 9),
        effect("early", 50, 1.0, 3),
        effect("close", 50, 0.5, 9),
        effect("never", 50, None, 9),  # 1.8 s or more
        effect("better", 60, None, 9),
        effect("worse", 10, 1.0, 9),
    ]
    found = rank_effects(scenario("a", 50, min_ttc=1.0), effects)
    assert [one.mute[0] for one in found.effects] == ["worse", "better", "never", "close", "early", "late", "none"]


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("talk") / "run"
    ended = invoke("eval", "--scenario", "i02_*", "--agent", TALKER, "--workers", 1, "--out", folder)
    assert ended.exit_code == 0, ended.output
    return folder


def test_an_episode_without_single_senders(finished: Path) -> None:
    ended = invoke("study", "ablate", finished, "--json", "--workers", 1)
    assert ended.exit_code == 0, ended.output
    page = json.loads(ended.stdout)
    found = {effect["mute"][0]: effect for effect in page["effects"]}
    senders = sorted({sent.message.sender for sent in recorded(finished).messages})
    assert set(found) == {*(f"{sender}/*" for sender in senders), "*/text"}
    assert all(effect["parted"] == 2 for effect in found.values())  # said in tick 0, heard in 1, somewhere else in 2
    assert found["*/text"]["messages"] == sum(found[f"{sender}/*"]["messages"] for sender in senders)
    changes = [abs(effect["ds_change"]) for effect in page["effects"]]
    assert changes == sorted(changes, reverse=True) and changes[0] > 0
    silent = invoke("eval", "--scenario", "i02_*", "--agent", TALKER, "--comm", "off", "--out", finished.parent / "off")
    assert silent.exit_code == 0
    alone = load_results(finished.parent / "off" / "results.json").scenarios[0]
    assert (found["*/text"]["ds"], found["*/text"]["digest"]) == (alone.ds, alone.digest)


def recorded(folder: Path) -> EpisodeRecord:
    return load_episode(next((folder / "episodes").glob("*.npz")))


def test_an_episode_without_one_message(finished: Path) -> None:
    ended = invoke("study", "ablate", finished, "--mute", "0/text@20", "--mute", "*/text@5000", "--workers", 1)
    assert ended.exit_code == 2 and "fits a message, found '*/text@5000'" in ended.stderr
    ended = invoke("study", "ablate", finished, "--mute", "0/text@20", "--workers", 1)
    assert ended.exit_code == 0, ended.output
    row = ended.stdout.splitlines()[-1].split()
    assert row[:2] == ["0/text@20", "1"] and row[-3:] == ["22", "(1.10", "s)"]


def test_nothing_is_told_of_a_recording_that_comes_out_differently(finished: Path, tmp_path: Path) -> None:
    """The journal's channel is changed: what is executed again is another run."""
    folder = tmp_path / "run"
    subprocess.run(["cp", "-r", str(finished), str(folder)], check=True)
    journal = folder / "journal.jsonl"
    header, *rest = journal.read_text().splitlines()
    values = json.loads(header)
    values["fingerprint"]["comm"] = format_comm_json(CommSettings(link=LinkSettings(latency_ticks=9)))
    journal.write_text("\n".join((json.dumps(values), *rest)) + "\n")
    ended = invoke("study", "ablate", folder, "--workers", 1)
    assert ended.exit_code == 1
    assert "the recording itself comes out differently: tick 1: messages that arrive" in ended.stderr
    assert ended.stdout == ""


def test_without_a_recording_there_is_nothing_to_ablate(finished: Path, tmp_path: Path) -> None:
    subprocess.run(["cp", "-r", str(finished), str(tmp_path / "run")], check=True)
    next((tmp_path / "run" / "episodes").glob("*.npz")).unlink()
    ended = invoke("study", "ablate", tmp_path / "run")
    assert ended.exit_code == 2 and "expected a recording of i02" in ended.stderr


@pytest.mark.slow
def test_show_finds_or_drives_the_references(finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    plain = invoke("show", finished)
    assert plain.exit_code == 0 and "scenario mean" in plain.stdout and "captured" not in plain.stdout
    first = invoke("show", finished, "--captured", "--out", "report.md", "--workers", 1)
    assert first.exit_code == 0, first.output
    assert first.stderr.count("reference ") == 2 and "1/1" in first.stderr
    assert "captured [%]" in first.stdout and "captured [%]" in Path("report.md").read_text()
    again = invoke("eval", "--scenario", "i02_*", "--agent", TALKER, "--captured", "--workers", 1)
    assert again.exit_code == 0, again.output
    assert again.stderr.count("already complete") == 2  # the references of `show`
    rows = [text.splitlines()[3:7] for text in (first.stdout, again.stdout)]
    assert rows[0] == rows[1]
    journal = next(Path("runs").glob("*-off")) / "journal.jsonl"
    journal.write_text(journal.read_text().replace('"code":"sha256:', '"code":"sha256:0'))
    stale = invoke("show", finished, "--captured")
    assert stale.exit_code == 2 and stale.stderr.endswith("; remove that folder to have it driven anew\n")
    assert invoke("show", "i02_*", "--captured").exit_code == 2


@pytest.mark.slow
def test_a_study_with_the_simulation(tmp_path: Path) -> None:
    given = ("--scenario", "i02_*", "--agents", f"{TALKER},constant-speed", "--no-captured", "--workers", 1)
    ended = invoke("study", "comm", *given, "--loss", "1", "--out", tmp_path / "out")
    assert ended.exit_code == 0, ended.output
    page = json.loads((tmp_path / "out" / "study.json").read_text())
    base, lossy = (line for line in page["lines"] if line["agent"] == TALKER)
    heard, unheard = (line["runs"][0]["scenarios"]["i02_ins_c_boulevard_straight"] for line in (base, lossy))
    assert heard["digest"] != unheard["digest"]
    counts = unheard["comm"]
    assert counts["lost"] > 0 and counts["delivered"] == 0
    assert [line["reused"] for line in page["lines"] if line["agent"] == "constant-speed"] == [False, True]
