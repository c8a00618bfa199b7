"""RunConfig, AgentSpec and EpisodeOptions: their serialised form, pickling, and agents given as a class."""

import json
import pickle
from collections.abc import Callable
from dataclasses import replace
from inspect import signature
from itertools import count
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
import pytest

import mdrive_sumo as md
from mdrive_sumo.actors import ActorMode
from mdrive_sumo.cli.evaluate import command as eval_command
from mdrive_sumo.contract import Briefing, Observation, OwnState, Reply, SensorSpec
from mdrive_sumo.core.clock import Clock
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.setting import list_settings
from mdrive_sumo.episode.episode_options import EpisodeArguments, EpisodeOptions
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_job import EpisodeJob
from mdrive_sumo.runs.open_agents import declare_agent, open_agents
from mdrive_sumo.runs.run_config import RunArguments, RunConfig, load_agent_config
from mdrive_sumo.scenario.weather import FrictionMode
from mdrive_sumo.scoring import RunInfo, ScoreMode
from mdrive_sumo.sensing.sensing_profile import SensingProfile
from mdrive_sumo.v2x.comm_settings import PRESETS, CommSettings, LinkSettings

OPTIONS = EpisodeOptions(
    CommSettings("realistic", link=LinkSettings(2, 0.1, 150.0), by_type={"cpm": LinkSettings(3)}, mute=("1/cam",)),
    Clock("fixed", 2),
    ActorMode.ORIGINAL,
    FrictionMode.WEATHER,
    sensing=SensingProfile.PERFECT,
)
CONFIG = RunConfig(
    suite="interdrive@0",
    scenario="i13*",
    agent=AgentSpec("sharing", {"range": 80.0, "a": True}),
    seeds=(3,),
    options=OPTIONS,
    record=False,
)
WRITTEN = {
    "suite": "interdrive",
    "scenario": "i13*",
    "agent": "sharing",
    "agent_config": '{"a":true,"range":80.0}',
    "seed": 3,
    "score_mode": "mdrive",
    "comm": '{"cpm.latency_ticks":3,"cpm.loss":0.0,"cpm.pose_error_deg":0.0,"cpm.pose_error_m":0.0,'
    '"cpm.pose_error_per":"message","header_bytes":0,"latency_ticks":2,"loss":0.1,"mute":"1/cam","on":true,'
    '"pose_error_deg":0.0,"pose_error_m":0.0,"pose_error_per":"message","preset":"realistic","range_m":150.0}',
    "agent_clock": "fixed:100",
    "actors": "original",
    "friction": "weather",
    "ids": "random",
    "sensing": "perfect",
    "sandbox": False,
    "record": False,
}
"""What journals hold: a changed form makes every stored run unreadable."""
FACTS = {"agent": "idm", "suite": "s", "suite_checksum": "", "seed": 0, "score_mode": "mdrive", "versions": {}}


def test_the_written_form_is_that_of_stored_runs() -> None:
    assert CONFIG.to_dict() == WRITTEN
    assert RunConfig.from_dict(WRITTEN) == replace(CONFIG, chosen_mode=ScoreMode.MDRIVE)  # a stored run names its mode


def test_a_stored_run_of_a_later_season_names_it() -> None:
    later = replace(CONFIG, suite="interdrive@2")
    assert later.to_dict()["suite"] == "interdrive@2"
    assert RunConfig.from_dict(later.to_dict()).suite == "interdrive@2"


def test_a_journal_from_before_an_option_has_its_default() -> None:
    assert RunConfig.from_dict({key: WRITTEN[key] for key in WRITTEN if key != "friction"}).options.friction == "dry"


def test_a_journal_from_before_sandboxes_is_of_a_run_without_one() -> None:
    assert not RunConfig.from_dict({key: WRITTEN[key] for key in WRITTEN if key != "sandbox"}).sandbox


@pytest.mark.parametrize(
    "key", ["suite", "scenario", "agent", "agent_config", "seed", "score_mode", "record", "comm", "agent_clock"]
)
def test_a_fingerprint_without_what_every_run_has_is_refused(key: str) -> None:
    with pytest.raises(KeyError, match=key):
        RunConfig.from_dict({name: WRITTEN[name] for name in WRITTEN if name != key})


@pytest.mark.parametrize("key", ["agent_clock", "actors", "friction", "sensing", "score_mode", "comm"])
def test_a_corrupt_value_is_refused(key: str) -> None:
    with pytest.raises((ValueError, InputError)):
        RunConfig.from_dict(WRITTEN | {key: "{" if key == "comm" else "sometimes"})


def test_results_describe_every_option() -> None:
    assert set(OPTIONS.to_dict()) <= set(RunInfo.model_fields)
    conditions = RunInfo.model_validate(FACTS).conditions
    assert set(conditions) == {"actors", "friction", "ids", "sensing", "v2x rate", "attack"}
    assert RunInfo.model_validate(FACTS | {"sensing": "perfect"}).conditions["sensing"] == "perfect"


def test_results_from_before_a_condition_state_only_what_was_so() -> None:
    """Roads were dry and road users those of today; ids were the scenario's, and sensing was another one."""
    conditions = {"actors": "default", "friction": "dry", "ids": "unknown", "sensing": "unknown"}
    conditions |= {"attack": "none", "v2x rate": "fixed"}
    info = RunInfo.model_validate(FACTS)
    assert (info.conditions, info.model_dump()["ids"], info.model_dump()["sensing"]) == (conditions, "", "")
    written = RunInfo.model_validate(FACTS | EpisodeOptions().to_dict() | {"comm": {}}).model_dump()
    assert (written["ids"], written["sensing"]) == ("random", "realistic")


def test_a_setting_that_came_later_is_written_only_where_it_is_not_its_default() -> None:
    fixed, etsi = (RunConfig.parse("interdrive", "sharing", v2x_rate=rate) for rate in ("fixed", "etsi"))
    assert "v2x_rate" not in fixed.to_dict() and etsi.to_dict()["v2x_rate"] == "etsi"
    assert RunConfig.from_dict(etsi.to_dict()).options == etsi.options
    assert fixed.default_folder("x") == RunConfig.parse("interdrive", "sharing").default_folder("x")
    assert etsi.default_folder("x").name == f"{fixed.default_folder('x').name}-etsi-v2x_rate"
    facts = {**FACTS, "comm": {}}
    infos = [RunInfo.model_validate(facts | {"v2x_rate": rate}) for rate in ("fixed", "etsi")]
    assert ["v2x_rate" in info.model_dump() for info in infos] == [False, True]
    assert ["v2x rate" in info.shown_conditions for info in infos] == [False, True]
    assert [info.conditions["v2x rate"] for info in infos] == ["fixed", "etsi"]


def test_every_setting_has_its_line_for_type_checkers() -> None:
    """`RunArguments` are the arguments of `evaluate`, of which it declares two itself."""
    assert {"suite", "agent", *get_type_hints(RunArguments)} == {one.key for one in list_settings(RunConfig)}
    assert set(get_type_hints(EpisodeArguments)) == {one.key for one in list_settings(EpisodeOptions)}


def test_evaluate_shows_every_setting_with_its_default() -> None:
    parameters = signature(md.evaluate).parameters
    assert list(parameters) == [
        "suite",
        "agent",
        "progress",
        *(one.key for one in list_settings(RunConfig) if one.key not in ("suite", "agent")),
    ]
    assert {name: parameters[name].default for name in ("agent", "comm", "seeds", "sensing", "record", "workers")} == {
        **{"agent": "idm", "comm": "ideal", "seeds": 1, "sensing": "realistic", "record": True, "workers": None},
    }


def test_every_setting_has_an_option() -> None:
    options = {param.name for param in eval_command.params}
    assert options >= {one.key for one in list_settings(RunConfig)}
    assert options - {one.key for one in list_settings(RunConfig)} == {
        *("seed", "transcript", "executor", "captured"),
        *("comm_latency", "comm_loss", "comm_range", "comm_budget", "pose_error", "comm_mute"),
        *("comm_power", "comm_gain", "comm_corner", "connected_background"),
    }


def test_every_setting_of_the_identity_is_in_a_journal_and_no_other() -> None:
    identity = {one.key for one in list_settings(RunConfig) if one.is_identity}
    limits = {"agent_limits": {"tick": 30.0}, "agent": "mine.py:Mine"}
    later = {"attack": "hide", "v2x_rate": "etsi"}
    config = RunConfig.parse(**limits, **later, others="idm", penetration=50, seeds=2)  # pyright: ignore
    assert identity | {"seed"} == {*config.to_dict()}


def test_the_defaults_of_the_arguments_are_those_of_the_model() -> None:
    assert RunConfig.parse() == RunConfig()
    typed = {one.key: one.typed_default for one in list_settings(RunConfig) if one.typed_default is not None}
    assert RunConfig.parse(**typed) == RunConfig()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"sede": 3}, "sede: unknown option, expected one of suite, .*did you mean 'seeds'?"),
        ({"score_mode": "mdriv"}, "score_mode: .*did you mean 'mdrive'?"),
        ({"pace_ms": 2000}, r"pace_ms: expected a number from 0 to 1000 \[ms\], found 2000"),
        ({"workers": "2"}, "workers: expected a whole number from 1, found '2'"),
        ({"record": "no"}, "record: expected True or False, found 'no'"),
        ({"workers": -1}, "workers: expected a whole number from 1, found -1"),
        ({"workers": True}, "workers: expected a whole number from 1, found True"),
        ({"pace_ms": True}, r"pace_ms: expected a number from 0 to 1000 \[ms\], found True"),
        ({"pace_ms": np.array([1.0, 2.0])}, r"pace_ms: expected a number from 0 to 1000 \[ms\], found array"),
        ({"penetration": 0}, r"penetration: expected a whole number from 1 to 99 \[percent\], found 0"),
        ({"penetration": "50"}, r"penetration: expected a whole number from 1 to 99 \[percent\], found '50'"),
        ({"penetration": 50.5}, r"penetration: expected a whole number from 1 to 99 \[percent\], found 50.5"),
        ({"others": 4}, "others: agent: expected a name .* found 4"),
        ({"agent_limits": 4}, "--agent-limits: expected a text or a mapping of seconds, found 4"),
        ({"agent_limits": 0}, "--agent-limits: expected a text or a mapping of seconds, found 0"),
        ({"agent_limits": {3: 4}}, "--agent-limits: expected one of start, tick, episode, found '3'"),
        ({"agent_clock": 5}, "agent_clock: expected ideal, fixed:MS, measured or a Clock, found 5"),
        ({"agent_clock": None}, "agent_clock: expected ideal, fixed:MS, measured or a Clock, found None"),
        ({"agent_config": 0}, "agent_config: expected a mapping of options, found 0"),
        ({"agent_config": {"a": [1]}}, r"agent_config: a: expected a finite number, .* found \[1\]"),
        ({"agent_config": {1: 2, "a": 3}}, "agent_config: expected names of options, found 1"),
        ({"sensing": np.array(["perfect", "perfect"])}, "sensing: expected one of realistic, perfect, found"),
        ({"seeds": 2000}, "seeds: expected at most 1000, found more"),
        ({"seeds": count()}, "seeds: expected at most 1000, found more"),
        ({"seeds": [-1]}, "seed: expected an integer from 0 to 2147483647, found -1"),
        ({"seeds": [2**31]}, "seed: expected an integer from 0 to 2147483647, found 2147483648"),
        ({"seeds": True}, "seeds: expected an integer, found True"),
        ({"seeds": np.array([[1]])}, "seed: expected an integer, found"),
        ({"sensing": "good"}, "sensing: expected one of realistic, perfect, found 'good'"),
        ({"scenario": ["i02"]}, "scenario: expected a text, found"),
    ],
)
def test_wrong_arguments_get_a_sentence(arguments: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        RunConfig.parse(**arguments)


def test_values_of_numpy_are_read_as_those_of_python() -> None:
    given = {"record": np.bool_(False), "penetration": np.int64(50), "pace_ms": np.float32(2), "workers": np.int8(2)}
    config = RunConfig.parse(**given, seeds=np.array(3))  # pyright: ignore
    assert config.record is False and config.seeds == (0, 1, 2) and config.workers == 2 and config.pace_ms == 2.0
    assert json.loads(json.dumps(config.to_dict()))["penetration"] == 50


def test_a_job_survives_pickling() -> None:
    job = EpisodeJob(Path("/suite"), "i13", CONFIG.agent, 3, ScoreMode.MDRIVE, OPTIONS, logs=Path("/logs"))
    assert pickle.loads(pickle.dumps(job)) == job


def test_presets_survive_pickling() -> None:
    assert all(pickle.loads(pickle.dumps(comm)) == comm for comm in PRESETS.values())


def make_local_class() -> type:
    """Return a class that no other process can import, as one of a notebook."""

    class Counter:
        label = "single"

        def __init__(self, config: dict[str, float]) -> None:
            self.range_m = config["range"]

        def sensors(self) -> tuple[SensorSpec, ...]:
            return (SensorSpec("objects", range_m=self.range_m),)

        def start(self, briefing: Briefing) -> None: ...

        def act(self, seen: Observation) -> Reply | None:
            raise ValueError(f"tick {seen.tick}")

    return Counter


@pytest.fixture
def spec() -> AgentSpec:
    return AgentSpec(make_local_class(), {"range": 30.0})


@pytest.mark.slow
def test_a_class_runs_in_a_process_of_its_own(spec: AgentSpec) -> None:
    in_worker = pickle.loads(pickle.dumps(spec))
    assert in_worker.agent is not spec.agent or in_worker == spec
    assert declare_agent(in_worker).sensors == (SensorSpec("objects", range_m=30.0),)
    with open_agents(in_worker, {"a": "a"}) as drivers:
        drivers["a"].sensors()
        drivers["a"].ask(Observation(7, OwnState(0, 0, 0, 0, 0, 0, 0)))
        with pytest.raises(Exception, match="ValueError: tick 7"):
            drivers["a"].answer()


def test_a_class_has_a_name_and_a_checksum_of_its_source(spec: AgentSpec) -> None:
    assert spec.name.endswith("Counter") and spec.resolve() == spec
    assert spec.code_checksum() == AgentSpec(make_local_class()).code_checksum() != ""
    other: Callable[..., object] = type("Other", (spec.agent,), {"start": lambda self, briefing: None})
    assert AgentSpec(other).code_checksum() != spec.code_checksum()


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("{", "expected JSON, found none"),
        ("[1]", "expected a JSON object, found a list"),
        ('{"a": [1]}', r"a: expected a finite number, a string or a boolean, found \[1\]"),
        ('{"a": NaN}', "a: expected a finite number"),
        ('{"a": null}', "a: expected a finite number"),
    ],
)
def test_an_unusable_agent_config_is_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "config.json"
    path.write_text(text)
    with pytest.raises(InputError, match=sentence):
        load_agent_config(path)


def test_an_agent_config_is_read_from_json(tmp_path: Path) -> None:
    path = tmp_path / "config.json"
    path.write_text(json.dumps({"speed": 8, "polite": True, "name": "x"}))
    assert load_agent_config(path) == {"speed": 8, "polite": True, "name": "x"}
    with pytest.raises(InputError, match="cannot be read: No such file"):
        load_agent_config(tmp_path / "missing.json")


def test_different_runs_get_different_folders() -> None:
    configs = (
        RunConfig(),
        RunConfig(seeds=(1,)),
        RunConfig(agent=AgentSpec("omniscient")),
        RunConfig(agent=AgentSpec("a/b.py:Mine")),
        RunConfig(agent=AgentSpec("idm", {"speed": 3})),
        RunConfig(scenario="ins_c*"),
        RunConfig(record=False),
        RunConfig(options=EpisodeOptions(friction=FrictionMode.WEATHER)),
        RunConfig(options=EpisodeOptions(comm=PRESETS["realistic"], actor_mode=ActorMode.ORIGINAL)),
    )
    folders = [str(config.default_folder("interdrive")) for config in configs]
    assert len(set(folders)) == len(folders)
    assert folders[0] == "runs/interdrive-idm-seed0"
    assert folders[3] == "runs/interdrive-b_Mine-seed0"
    assert folders[7:] == ["runs/interdrive-idm-seed0-weather-friction",
                           "runs/interdrive-idm-seed0-realistic-original-actors"]  # fmt: skip
