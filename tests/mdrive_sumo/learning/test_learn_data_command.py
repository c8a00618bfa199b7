"""`mdrive-sumo learn data` on the command line, with cameras, and with a learner that drives."""

import io
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from PIL import Image
from testing.camera_scenes import needs_opengl
from testing.local_executor import LocalExecutor
from testing.short_suite import make_short_suite
from testing.tiny_network import TinyNetwork, save_tiny_weights

from mdrive_sumo.agents.learned.instructions import VOCABULARY, split_words
from mdrive_sumo.agents.learned.system_spec import SYSTEMS
from mdrive_sumo.cli import main
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.learning.sample_format import DatasetFile, build_training_data_schema
from mdrive_sumo.learning.sample_reader import TrainingSample, load_arrays, read_samples
from mdrive_sumo.learning.shard_reading import load_dataset_file
from mdrive_sumo.learning.training_places import open_training_place
from mdrive_sumo.worlds.places import PLACE_FILE

pytestmark = pytest.mark.slow
SCENARIO = "i07*"


@pytest.fixture
def suite(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folder of a suite with one scenario of 20 m; the command drives it in this process."""
    monkeypatch.setattr("mdrive_sumo.learning.collection.make_executor", LocalExecutor)
    return make_short_suite(tmp_path / "suite", SCENARIO, metres=20)


def learn_data(out: Path, *words: str | Path) -> Result:
    return CliRunner().invoke(main, ["learn", "data", "--split", "train", "--out", str(out), *map(str, words)])


def read_all(folder: Path, system: str) -> list[TrainingSample]:
    return list(read_samples(folder, SYSTEMS[system]))


@needs_opengl
def test_cameras_of_all_systems_are_recorded(suite: Path, tmp_path: Path) -> None:
    rigs = ("--rig", "tcp", "--rig", "vad", "--rig", "uniad", "--rig", "lmdrive")
    ended = learn_data(tmp_path / "set", "--suite", suite, "--scenarios", 1, *rigs)
    assert ended.exit_code == 0, ended.output
    about = load_dataset_file(tmp_path / "set")
    assert about.rigs == ("lmdrive", "tcp", "vad") and about.samples > 20
    for name, spec in SYSTEMS.items():
        arrays = load_arrays(tmp_path / "set", spec)
        for image in spec.images:
            assert arrays[image.name].std(axis=(1, 2, 3, 4)).min() > 5.0, f"{name}: an image without content"
    scans = load_arrays(tmp_path / "set", SYSTEMS["lmdrive"])["lidar"]
    assert (scans.sum(axis=(2, 3)) > 0).all()
    shown = {word for sample in read_all(tmp_path / "set", "lmdrive") for word in split_words(sample.instruction)}
    assert shown and shown <= set(VOCABULARY)


@needs_opengl
@pytest.mark.parametrize("expert", ["omniscient", "single"])
def test_a_learner_drives_and_the_expert_answers(expert: str, suite: Path, tmp_path: Path) -> None:
    weights = save_tiny_weights(tmp_path, SYSTEMS["vad"], TinyNetwork(speed=3.0))
    words = ("--suite", suite, "--scenarios", 1, "--rig", "vad", "--expert", expert, "--driver", weights)
    ended = learn_data(tmp_path / "set", *words, "--mix", 0)
    assert ended.exit_code == 0, ended.output
    samples = read_all(tmp_path / "set", "vad")
    assert {sample.about.round for sample in samples} == {1}
    assert all(sample.labels["perturbed"] for sample in samples)
    speeds = np.array([sample.labels["own"][3] for sample in samples])
    assert 2.0 < np.median(speeds[len(speeds) // 2 :]) < 4.5  # as fast as the tiny network answers
    answers = np.array([np.hypot(*(sample.labels["expert_plan"][1])) for sample in samples])
    assert answers.max() > 4.5  # the expert would drive faster than 3 m/s
    assert load_dataset_file(tmp_path / "set").driver.startswith("sha256:")


@needs_opengl
def test_expert_and_learner_take_turns(suite: Path, tmp_path: Path) -> None:
    weights = save_tiny_weights(tmp_path, SYSTEMS["vad"], TinyNetwork(speed=3.0))
    words = ("--suite", suite, "--scenarios", 1, "--rig", "vad", "--driver", weights)
    assert learn_data(tmp_path / "set", *words, "--mix", 1.0, "--round", 4).exit_code == 0
    samples = read_all(tmp_path / "set", "vad")
    assert {sample.about.round for sample in samples} == {4}
    assert not any(sample.labels["perturbed"] for sample in samples)


MISTAKES: dict[str, tuple[tuple[str, ...], str]] = {
    "rig": (("--rig", "vat"), "--rig: expected one of tcp, vad, uniad, lmdrive, found 'vat'; did you mean 'vad'?"),
    "expert": (("--expert", "idm"), "expected one of omniscient, sharing+negotiation, single, found 'idm'"),
    "split": (("--split", "trial"), "--split"),
    "no scenarios": (("--scenarios", "0"), "'--scenarios'"),
    "rate": (("--perturb", "-1"), "'--perturb'"),
    "no number": (("--perturb", "nan"), "'--perturb': expected a number, found 'nan'"),
    "no weights": (("--driver", "none.onnx"), "none.onnx: expected a file with weights (ONNX), found none"),
    "no driver": (("--mix", "0.5"), "--mix and --round go only with --driver"),
    "suite": (("--suite", "nothing"), "suite 'nothing': expected a folder or one of"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_one_sentence(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("mdrive_sumo.learning.collection.make_executor", LocalExecutor)
    words, part = MISTAKES[name]
    defaults = {"--scenarios": "1", "--split": "train"}
    missing = [word for option, value in defaults.items() if option not in words for word in (option, value)]
    ended = CliRunner().invoke(main, ["learn", "data", "--out", "set", *missing, *words])
    assert ended.exit_code == 2 and "Traceback" not in ended.output
    assert part in " ".join(ended.output.split())


def test_a_driver_without_its_rig_or_its_manifest_is_refused(suite: Path, tmp_path: Path) -> None:
    weights = save_tiny_weights(tmp_path, SYSTEMS["uniad"])
    ended = learn_data(tmp_path / "set", "--suite", suite, "--scenarios", 1, "--rig", "tcp", "--driver", weights)
    assert ended.exit_code == 2 and "expected the rig that it sees with, --rig vad, found none" in ended.output
    weights.with_suffix(".json").unlink()
    ended = learn_data(tmp_path / "set", "--suite", suite, "--scenarios", 1, "--rig", "vad", "--driver", weights)
    assert ended.exit_code == 2 and "manifest of weights" in ended.output
    ended = learn_data(tmp_path / "set", "--suite", suite, "--scenarios", 1, "--driver", weights, "--round", 0)
    assert ended.exit_code == 2 and "expected 1 or more with --driver" in ended.output


def test_ctrl_c_says_how_to_continue(suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("signal.signal", lambda *_: None)  # the command ignores a second Ctrl-C
    with monkeypatch.context() as patch:
        patch.setattr("mdrive_sumo.learning.collection.run_jobs", interrupt)
        ended = learn_data(tmp_path / "set", "--suite", suite, "--scenarios", 1)
    assert ended.exit_code == 130 and "interrupted; the same command continues" in ended.output
    assert load_dataset_file(tmp_path / "set").samples == 0
    assert learn_data(tmp_path / "set", "--suite", suite, "--scenarios", 1).exit_code == 0


def test_a_place_that_was_brought_along_needs_no_netconvert(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("collection", "training_places"):
        monkeypatch.setattr(f"mdrive_sumo.learning.{module}.make_executor", LocalExecutor)
    made = learn_data(tmp_path / "set", "--scenarios", 1)
    assert made.exit_code == 0, made.output
    samples = list(read_samples(tmp_path / "set"))
    places = {path.name: json.loads((path / PLACE_FILE).read_text()) for path in (tmp_path / "places").iterdir()}
    assert samples and {sample.about.network for sample in samples} <= set(places)
    assert all(about["seed"].startswith("training/train/0/0-") for about in places.values())

    def find_none(*_: object) -> None:
        raise InputError("netconvert: expected an executable, found none")

    open_training_place.cache_clear()
    monkeypatch.setattr("mdrive_sumo.worlds.places.recipe.run_netconvert", find_none)
    brought = learn_data(tmp_path / "elsewhere/set", "--scenarios", 1, "--places", tmp_path / "places")
    assert brought.exit_code == 0, brought.output
    shards = [tmp_path / name / "shard-000000.tar" for name in ("set", "elsewhere/set")]
    assert shards[0].read_bytes() == shards[1].read_bytes()
    open_training_place.cache_clear()
    missing = learn_data(tmp_path / "alone/set", "--scenarios", 1)
    assert missing.exit_code == 2 and "netconvert: expected an executable" in missing.output


def test_the_published_schema_is_that_of_the_code() -> None:
    published = json.loads(CliRunner().invoke(main, ["schema", "training-data"]).output)
    assert published == json.loads(json.dumps(build_training_data_schema()))
    assert published["dataset.json"] == DatasetFile.model_json_schema()


def test_images_are_stored_with_full_colour_resolution() -> None:
    from mdrive_sumo.contract import CameraImage
    from mdrive_sumo.learning.sample_format import decode_image, encode_image

    pixels = np.zeros((16, 32, 3), np.uint8)
    pixels[:, ::2, 0], pixels[:, 1::2, 2] = 200, 200
    data = encode_image(CameraImage("rgb", pixels, 20.0))
    with Image.open(io.BytesIO(data)) as image:
        assert image.format == "JPEG" and image.size == (32, 16)
    assert np.abs(decode_image(data).astype(int) - pixels).mean() < 8.0
