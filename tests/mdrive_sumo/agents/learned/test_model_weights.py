"""Weights of learned systems: a table of bad files with one sentence each, and what a loaded network does."""

import hashlib
import importlib.util
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from testing.onnx_writer import Array, Node, write_model
from testing.tiny_network import TinyNetwork, save_tiny_weights

from mdrive_sumo.agents.learned.model_weights import load_network
from mdrive_sumo.agents.learned.network_inputs import Inputs, describe_inputs
from mdrive_sumo.agents.learned.system_spec import SYSTEMS
from mdrive_sumo.agents.learned.tcp import TcpAgent
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.onnx_weights import CPU_PROVIDER

TCP = SYSTEMS["tcp"]


def change_manifest(path: Path, **values: Any) -> None:
    file = path.with_suffix(".json")
    file.write_text(json.dumps(json.loads(file.read_text()) | values))


def replace_network(path: Path, content: bytes) -> None:
    """With the right checksum."""
    path.write_bytes(content)
    change_manifest(path, sha256=hashlib.sha256(content).hexdigest())


def cut_image(path: Path) -> None:
    """The network of another image size and with another output."""
    inputs = [Array(name, (1, *shape), kind) for name, (shape, kind) in describe_inputs(TCP).items()]
    inputs[0] = Array("front", (1, 1, 64, 64, 3), "uint8")
    replace_network(
        path, write_model([Node("Identity", ("navigation",), "plan")], {}, inputs, [Array("plan", (1, 12))])
    )


def answer_plan_only(path: Path) -> None:
    content = TinyNetwork().write(SYSTEMS["vad"])
    replace_network(path, content)


BAD_FILES: list[tuple[Callable[[Path], object], str]] = [
    (lambda path: path.unlink(), r"weights .*tcp\.onnx: cannot be read: No such file"),
    (lambda path: path.with_suffix(".json").unlink(), r"manifest of weights .*tcp\.json: cannot be read: No such file"),
    (lambda path: path.with_suffix(".json").write_text("{"), "expected JSON, found an error"),
    (lambda path: path.with_suffix(".json").write_bytes(b"\xff"), "expected JSON, found an error"),
    (lambda path: path.with_suffix(".json").write_text("[" * 100_000), "expected JSON, found an error"),
    (lambda path: path.with_suffix(".json").write_text("[]"), "expected a JSON object, found list"),
    (lambda path: path.with_suffix(".json").write_text("{}"), "expected format version 1, found None"),
    (lambda path: change_manifest(path, format_version=2), "expected format version 1, found 2; use weights"),
    (lambda path: change_manifest(path, sha256="abc"), "sha256: String should match"),
    (lambda path: change_manifest(path, colour="red"), "colour: Extra inputs are not permitted, found 'red'"),
    (lambda path: change_manifest(path, system="vad"), "expected those of the system 'tcp', found 'vad'"),
    (lambda path: path.write_bytes(path.read_bytes()[:-1]), "expected the checksum .*, found .*damaged"),
    (lambda path: replace_network(path, b"nothing"), "expected a network for ONNX Runtime"),
    (lambda path: replace_network(path, b""), "expected a network for ONNX Runtime"),
    (cut_image, r"input 'front': expected uint8 \[1, 1, 128, 450, 3\] .*, found uint8 \[1, 1, 64, 64, 3\]"),
    (answer_plan_only, r"input 'front': expected uint8 .* found none"),
]  # fmt: skip


@pytest.mark.parametrize(("damage", "words"), BAD_FILES)
def test_every_bad_file_is_one_sentence(tmp_path: Path, damage: Callable[[Path], object], words: str) -> None:
    path = save_tiny_weights(tmp_path, TCP)
    load_network(TCP, path)
    damage(path)
    with pytest.raises(InputError, match=words) as caught:
        load_network(TCP, path)
    assert "\n" not in str(caught.value)


def test_a_missing_output_is_named(tmp_path: Path) -> None:
    path = save_tiny_weights(tmp_path, TCP)
    inputs = [Array(name, (1, *shape), kind) for name, (shape, kind) in describe_inputs(TCP).items()]
    replace_network(
        path, write_model([Node("Identity", ("navigation",), "plan")], {}, inputs, [Array("plan", (1, 12))])
    )
    with pytest.raises(InputError, match=r"output 'control': expected float32 \[1, 3\] .*, found none"):
        load_network(TCP, path)


def test_a_missing_extra_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"agent tcp: expected ONNX Runtime .*pip install '\.\[learned\]'"):
        TcpAgent({})


@pytest.mark.parametrize(
    ("config", "words"),
    [
        ({"weights": "tcp.pt"}, "option weights: expected the path of a .onnx or .json file, found 'tcp.pt'"),
        ({"weights": 1.0}, "option weights: expected the path of a .onnx or .json file, found 1.0"),
        ({"provider": "tpu"}, "option provider: expected one of auto, cpu, found 'tpu'"),
        ({"blackout": 2.0}, r"option blackout: expected 0 or 1, found 2"),
        ({"wheels": 4.0}, "expected options among .blackout, creep, fusion, provider, weights.*found 'wheels'"),
    ],
)
def test_unusable_options_are_one_sentence(config: dict[str, float | str], words: str) -> None:
    with pytest.raises(InputError, match=words):
        TcpAgent(config)


def test_either_file_names_the_weights_and_agents_share_the_network(tmp_path: Path) -> None:
    path = save_tiny_weights(tmp_path, TCP)
    network = load_network(TCP, path)
    assert load_network(TCP, path.with_suffix(".json")) is network
    assert load_network(TCP, path, use_gpu=False).provider == CPU_PROVIDER
    save_tiny_weights(tmp_path, TCP, TinyNetwork(speed=2.0))
    assert load_network(TCP, path) is not network


def test_a_network_has_no_batch_dimension_outside(tmp_path: Path) -> None:
    network = load_network(TCP, save_tiny_weights(tmp_path, TCP, TinyNetwork(control=(0.25, 0.5, -0.5))))
    inputs: Inputs = {name: np.zeros(shape, kind) for name, (shape, kind) in describe_inputs(TCP).items()}
    inputs["navigation"][6:8] = 0.5, 0.25
    outputs = network.run(inputs)
    assert outputs["plan"].shape == (6, 2) and outputs["plan"][0].tolist() == [2.0, 1.0]
    assert outputs["control"].tolist() == [0.25, 0.5, -0.5]


def test_a_graphics_card_is_used_if_there_is_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The installed ONNX Runtime has no such provider; a stand-in records which ones it would be asked for."""
    import onnxruntime

    asked: list[list[str]] = []

    class Session:
        def __init__(self, content: bytes, options: object, providers: list[str]) -> None:
            asked.append(providers)

        def get_providers(self) -> list[str]:
            return asked[-1]

        get_inputs = get_outputs = list

    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: ["CUDAExecutionProvider", CPU_PROVIDER])
    monkeypatch.setattr(onnxruntime, "InferenceSession", Session)
    path = save_tiny_weights(tmp_path, TCP)
    for use_gpu in (True, False):
        with pytest.raises(InputError, match="input 'front'"):
            load_network(TCP, path, use_gpu)
    assert asked == [["CUDAExecutionProvider", CPU_PROVIDER], [CPU_PROVIDER]]
