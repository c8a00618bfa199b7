"""`colmdriver`: what speaks for it, by its options and the files that there are, and that verify needs neither."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner
from testing.tiny_negotiator import write_tiny_negotiator

from mdrive_sumo.agents import colmdriver
from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.cli import main
from mdrive_sumo.cli.study_agreements import agreements_command
from mdrive_sumo.contract.agent_options import Config
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.negotiation.dialogue.answer_writers import FormulaWriter, NetworkWriter, RandomWriter
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_job import replay_language_model

COMMAND = [sys.executable, "-c", f"import {main.__module__} as cli; cli.main()"]
ENDPOINT = "http://127.0.0.1:9/v1"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"talk": "pidgin"}, "option talk: expected one of endpoint, model, formula, random, found 'pidgin'"),
        ({"talk": "formula", "endpoint": ENDPOINT}, "option talk: expected 'endpoint' where one is given"),
        ({"weights": 3}, "option weights: expected the path of an .onnx or .json file, found 3"),
        ({"weights": "talker.pt"}, "option weights: expected the path of an .onnx or .json file, found 'talker.pt'"),
        ({"weights": "absent.onnx"}, "absent.json"),
        ({"talk": "formula", "critic": 0.5}, "option critic: expected 0 or 1, found 0.5"),
        ({"talk": "formula", "volume": 11}, "expected options among (api_key_env, "),
    ],
)
def test_unusable_options_are_refused_in_one_sentence(options: dict[str, float | str], words: str) -> None:
    with pytest.raises(InputError) as caught:
        AGENTS["colmdriver"](options)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_without_weights_it_needs_an_endpoint_or_says_what_needs_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(colmdriver, "WEIGHTS", tmp_path / "negotiator.onnx")
    with pytest.raises(InputError, match="option endpoint: expected the URL"):
        AGENTS["colmdriver"]({})
    with pytest.raises(
        InputError, match=r"expected weights of a language model .* found none; talk formula needs none"
    ):
        AGENTS["colmdriver"]({"talk": "model"})


def test_packaged_weights_speak_unless_an_endpoint_is_given(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(colmdriver, "WEIGHTS", write_tiny_negotiator(tmp_path))
    assert find_writer({}) is NetworkWriter
    assert find_writer({"talk": "formula"}) is FormulaWriter
    assert find_writer({"talk": "random"}) is RandomWriter
    assert AGENTS["colmdriver"]({"endpoint": ENDPOINT})._talk == "endpoint"  # type: ignore[attr-defined]


def find_writer(options: Config) -> type:
    from testing.planning import briefing, straight

    agent = colmdriver.ColmdriverAgent(options)
    return type(agent._build_writer(briefing(straight())))  # pyright: ignore[reportPrivateUsage]


def test_weights_of_another_vocabulary_are_refused(tmp_path: Path) -> None:
    path = write_tiny_negotiator(tmp_path, vocabulary="0" * 32)
    with pytest.raises(InputError, match=r"expected those of the vocabulary .* found those of 00000000"):
        AGENTS["colmdriver"]({"weights": str(path)})


def write_transcript(folder: Path, request: object) -> Path:
    line = {"seed": 1, "ordinal": 0, "digest": "0", "request": request, "answer": "propose A>B keep", "tokens": 0}
    path = folder / "t.jsonl"
    path.write_text(json.dumps(line) + "\n")
    return path


@pytest.mark.parametrize(
    ("request_body", "talk"), [({"task": "say"}, "model"), ({"messages": []}, "endpoint"), (None, "endpoint")]
)
def test_a_transcript_tells_which_model_it_is_of(tmp_path: Path, request_body: object, talk: str) -> None:
    agent = AGENTS["colmdriver"]({"transcript": str(write_transcript(tmp_path, request_body))})
    assert agent._talk == talk  # type: ignore[attr-defined]


def test_a_stored_run_is_repeated_without_endpoint_or_weights(tmp_path: Path) -> None:
    spec = AgentSpec("colmdriver", {"endpoint": ENDPOINT, "api_key_env": "KEY"})
    assert replay_language_model(spec, None).config == {"talk": "endpoint", "transcript": os.devnull}
    silent = replay_language_model(AgentSpec("colmdriver", {"weights": "gone.onnx"}), None)
    assert AGENTS["colmdriver"](silent.config).label == "negotiation"
    other = AgentSpec("sharing", {})
    assert replay_language_model(other, None) == other


@pytest.mark.slow
def test_a_run_is_verified_without_what_spoke(tmp_path: Path) -> None:
    """A whole run of random talk by the command line; its answers come from the transcript then."""
    options, out = tmp_path / "options.json", tmp_path / "run"
    options.write_text('{"talk": "random", "critic": 0}')
    command = [*COMMAND, "eval", "--agent", "colmdriver", "--agent-config", str(options), "--out", str(out)]
    subprocess.run([*command, "--suite", "interdrive@0", "--scenario", "i03*"], check=True, capture_output=True)
    assert (out / "transcript.jsonl").read_text()
    done = subprocess.run([*COMMAND, "verify", str(out)], check=True, capture_output=True, text=True)
    assert "answers of a language model" in done.stdout
    assert "identical" in done.stdout
    measured = CliRunner().invoke(agreements_command, [str(out)])
    assert measured.exit_code == 0
    assert "2 parties" in measured.stdout
