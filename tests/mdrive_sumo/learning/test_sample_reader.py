"""Reading a data set: arrays for training, and one clear sentence for every kind of damage."""

import io
import json
import re
import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from testing.training_data import copy_dataset

from mdrive_sumo.agents.learned.system_spec import PLAN_POINTS, ROUTE_POINTS, SYSTEMS, SystemSpec
from mdrive_sumo.core.checksum import compute_file_checksum
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.learning.recorded_rigs import find_rig_system, list_stored_images, parse_rig_names
from mdrive_sumo.learning.sample_format import DATASET_FILE, FORMAT, LABELS, split_key
from mdrive_sumo.learning.sample_reader import MAX_BOXES, load_arrays, read_samples
from mdrive_sumo.learning.shared_arrays import SharedArrays

pytestmark = [pytest.mark.slow, pytest.mark.costly_fixture]
SHARD = "shard-000000.tar"
FEW = 6
"""Samples of each CAV, 0.2 s apart."""
Files = dict[str, bytes]


def rewrite(folder: Path, change: Callable[[Files], None], adapt: bool = True) -> None:
    """Write the first shard again with changed files; adapt: and `dataset.json` with its size and checksum."""
    path = folder / SHARD
    files: Files = {}
    with tarfile.open(path) as shard:
        for member in shard:
            file = shard.extractfile(member)
            assert file is not None
            files[member.name] = file.read()
    change(files)
    with tarfile.open(path, "w", format=tarfile.USTAR_FORMAT) as shard:
        for name, data in files.items():
            member = tarfile.TarInfo(name)
            member.size = len(data)
            shard.addfile(member, io.BytesIO(data))
    if adapt:
        change_dataset(folder, lambda about: about["shards"][0].update(describe(path)))


def describe(path: Path) -> dict[str, Any]:
    return {"bytes": path.stat().st_size, "checksum": compute_file_checksum(path)}


def change_dataset(folder: Path, change: Callable[[dict[str, Any]], None]) -> None:
    path = folder / DATASET_FILE
    about = json.loads(path.read_text())
    change(about)
    path.write_text(json.dumps(about))


@pytest.fixture(scope="module")
def few(dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The data set with the first samples of each CAV only, over more than 0.4 s."""
    folder = copy_dataset(dataset, tmp_path_factory.mktemp("few") / "set")
    rewrite(folder, keep_first_samples)
    with tarfile.open(folder / SHARD) as shard:
        drives = [name.split("_")[0] for name in shard.getnames() if name.endswith("about.json")]

    def count(about: dict[str, Any]) -> None:
        (entry,) = about["shards"]
        entry["samples"] = len(drives)
        for scenario in entry["scenarios"]:
            scenario["samples"] = sum(drive.endswith(f"{scenario['index']:06d}") for drive in drives)
        assert sum(scenario["samples"] for scenario in entry["scenarios"]) == len(drives)

    change_dataset(folder, count)
    return folder


def keep_first_samples(files: Files) -> None:
    drives: dict[str, list[str]] = {}
    for key in dict.fromkeys(name.split(".", 1)[0] for name in files):
        drives.setdefault(split_key(key)[0], []).append(key)
    kept = {key for keys in drives.values() for key in keys[:FEW]}
    for name in [name for name in files if name.split(".", 1)[0] not in kept]:
        del files[name]


def add_images(folder: Path, spec: SystemSpec) -> None:
    """Give every sample made-up images of a system, as bright as its tick, and a scan if the system uses one."""

    def change(files: Files) -> None:
        for key in list(dict.fromkeys(name.split(".", 1)[0] for name in files)):
            grey = split_key(key)[1] % 200
            for image in spec.images:
                for name in list_stored_images(spec, image):
                    buffer = io.BytesIO()
                    Image.new("RGB", (image.width, image.height), (grey, grey, grey)).save(buffer, "JPEG", quality=95)
                    files[f"{key}.{name}.jpg"] = buffer.getvalue()
            if spec.uses_lidar:
                change_labels(files, f"{key}.labels.npz", lidar=np.full((2, 64, 64), grey, np.uint8))
        ordered = sorted(files.items(), key=lambda item: item[0].split(".", 1)[0])
        files.clear()
        files.update(ordered)

    rewrite(folder, change)
    change_dataset(folder, lambda about: about.update(rigs=list(parse_rig_names((spec.rig,)))))


def change_labels(files: Files, name: str, **arrays: np.ndarray | None) -> None:
    """Replace arrays of a sample; None removes one."""
    with np.load(io.BytesIO(files[name])) as archive:
        found: dict[str, np.ndarray | None] = {one: archive[one] for one in archive.files}
    found |= arrays
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **{one: value for one, value in found.items() if value is not None})  # type: ignore[arg-type]
    files[name] = buffer.getvalue()


def find_first(files: Files, suffix: str) -> str:
    return next(name for name in files if name.endswith(suffix))


def test_samples_come_in_order_with_all_labels(dataset: Path) -> None:
    keys = []
    for sample in read_samples(dataset):
        keys.append(sample.key)
        assert set(sample.labels) == set(LABELS) - {"lidar"}
        assert sample.instruction and sample.about.tick == split_key(sample.key)[1]
        assert len(sample.labels["boxes"]) == len(sample.labels["futures"])
    assert keys == sorted(keys) and len(set(keys)) == len(keys) > 200


@pytest.mark.parametrize("system", SYSTEMS)
def test_arrays_of_a_system(system: str, few: Path, tmp_path: Path) -> None:
    folder, spec = copy_dataset(few, tmp_path / "set"), SYSTEMS[system]
    add_images(folder, spec)
    samples = list(read_samples(folder, spec))
    arrays = load_arrays(folder, spec)
    count = len(samples)
    for image in spec.images:
        assert arrays[image.name].shape == (count, len(image.cameras), image.height, image.width, 3)
        assert arrays[image.name].dtype == np.uint8
        means = arrays[image.name].mean(axis=(1, 2, 3, 4))
        assert np.abs(means - [split_key(sample.key)[1] % 200 for sample in samples]).max() < 2.0
    assert arrays["route"].shape == (count, ROUTE_POINTS, 4)
    assert arrays["futures"].shape == (count, MAX_BOXES, PLAN_POINTS, 3)
    assert ("lidar" in arrays, "instruction" in arrays) == (spec.uses_lidar, spec.uses_instruction)
    for row, sample in enumerate(samples):
        for name in ("own", "navigation", "expert_plan", "expert_control", "occupancy", "perturbed"):
            np.testing.assert_array_equal(arrays[name][row], sample.labels[name])
        boxes = sample.labels["boxes"]
        np.testing.assert_array_equal(arrays["boxes"][row, : len(boxes)], boxes)
        assert np.isnan(arrays["boxes"][row, len(boxes) :]).all()


def test_workers_fill_the_same_rows(few: Path, tmp_path: Path) -> None:
    folder = copy_dataset(few, tmp_path / "set")
    add_images(folder, SYSTEMS["tcp"])
    alone, together = (load_arrays([folder, folder], SYSTEMS["tcp"], workers=workers) for workers in (1, 2))
    assert alone.keys() == together.keys()
    for name, array in alone.items():
        np.testing.assert_array_equal(array, together[name])


def test_shared_arrays_are_filled_from_elsewhere_and_stay() -> None:
    rows = {"a": np.zeros(3, np.float32), "b": np.zeros((), np.uint8)}
    with SharedArrays(rows, 4) as shared:
        for name, place in shared.places.items():
            place.open()[2:] = 7 if name == "a" else 8
    assert shared.arrays["a"].tolist() == [[0.0] * 3] * 2 + [[7.0] * 3] * 2
    assert shared.arrays["b"].tolist() == [0, 0, 8, 8]
    with pytest.raises(OSError):
        shared.places["a"].open()


def test_previous_rows_are_the_same_cars_0_4_s_earlier(few: Path, tmp_path: Path) -> None:
    folder = copy_dataset(few, tmp_path / "set")
    add_images(folder, SYSTEMS["vad"])
    keys = [split_key(sample.key) for sample in read_samples(folder)]
    arrays = load_arrays([folder, folder], SYSTEMS["vad"], workers=2)
    count = len(keys)
    assert any(before >= 0 for before in arrays["previous"])
    for row, before in enumerate(arrays["previous"].tolist()):
        drive, tick = keys[row % count]
        if before < 0:
            assert (drive, tick - 8) not in keys
        else:
            assert keys[before % count] == (drive, tick - 8) and before // count == row // count
    drives = dict.fromkeys(keys[row % count][0] + str(row // count) for row in range(2 * count))
    assert set(arrays["scenario"].tolist()) == {0, 1}
    assert arrays["episode"].tolist() == [
        list(drives).index(keys[row % count][0] + str(row // count)) for row in range(2 * count)
    ]
    np.testing.assert_array_equal(arrays["own"][:count], arrays["own"][count:])


def cut(folder: Path) -> None:
    path = folder / SHARD
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2 - 100])


def cut_with_its_size(folder: Path) -> None:
    """Before a sample: what is left is a tar file."""
    path = folder / SHARD
    with tarfile.open(path) as shard:
        members = shard.getmembers()
    size = next(member.offset for member in members[len(members) // 2 :] if member.name.endswith("labels.npz"))
    path.write_bytes(path.read_bytes()[:size])
    change_dataset(folder, lambda about: about["shards"][0].update(bytes=size))


def flip_a_bit(folder: Path) -> None:
    """In the middle of an image, which still decodes."""
    path = folder / SHARD
    with tarfile.open(path) as shard:
        image = next(member for member in shard if member.name.endswith(".jpg"))
    data = bytearray(path.read_bytes())
    data[image.offset_data + image.size // 2] ^= 1
    path.write_bytes(data)


def remove_file(suffix: str) -> Callable[[Path], None]:
    return lambda folder: rewrite(folder, lambda files: files.pop(find_first(files, suffix)))


def replace_file(suffix: str, data: bytes) -> Callable[[Path], None]:
    return lambda folder: rewrite(folder, lambda files: files.update({find_first(files, suffix): data}))


def replace_array(**arrays: np.ndarray | None) -> Callable[[Path], None]:
    return lambda folder: rewrite(folder, lambda files: change_labels(files, find_first(files, "labels.npz"), **arrays))


def remove_first_sample(files: Files) -> None:
    key = next(iter(files)).split(".", 1)[0]
    for name in [name for name in files if name.startswith(f"{key}.")]:
        del files[name]


SHARD_AND_KEY = rf"{SHARD}: train-s3-r0-000000_c\d_\d{{5}}: "
BROKEN: dict[str, tuple[Callable[[Path], object], str]] = {
    "no folder": (lambda folder: (folder / DATASET_FILE).unlink(), "expected a data set of `mdrive-sumo learn data`"),
    "another version": (
        lambda folder: change_dataset(folder, lambda about: about.update(format="mdrive-sumo/training-data/9")),
        f"{DATASET_FILE}: expected the format {FORMAT}, found 'mdrive-sumo/training-data/9'",
    ),
    "no JSON": (lambda folder: (folder / DATASET_FILE).write_text("{"), f"{DATASET_FILE}: "),
    "no shard": (lambda folder: (folder / SHARD).unlink(), f"{SHARD}: cannot be read: No such file"),
    "cut": (cut, rf"{SHARD}: expected \d+ bytes, found \d+; `learn data` makes the shard again"),
    "cut, size adapted": (cut_with_its_size, rf"{SHARD}: expected \d+ samples, found \d+; `learn data`"),
    "no tar": (
        lambda folder: (folder / SHARD).write_bytes(b"x" * (folder / SHARD).stat().st_size),
        rf"{SHARD}: expected a tar file, found after its beginning",
    ),
    "a bit": (flip_a_bit, rf"{SHARD}: expected the checksum sha256:\w+\.\.\., found sha256:"),
    "a sample less": (lambda folder: rewrite(folder, remove_first_sample), rf"{SHARD}: expected \d+ samples, found"),
    "a sample more": (
        lambda folder: change_dataset(folder, lambda about: about["shards"][0].update(samples=1)),
        rf"{SHARD}: expected 1 samples, found \d+",
    ),
    "no labels": (remove_file("labels.npz"), SHARD_AND_KEY + "expected a file .*labels.npz, found none"),
    "no image": (remove_file("tcp-front.jpg"), SHARD_AND_KEY + "expected a file .*tcp-front.jpg, found none"),
    "no about": (remove_file("about.json"), SHARD_AND_KEY + "expected a file .*about.json, found none"),
    "damaged labels": (replace_file("labels.npz", b"PK\x03\x04"), SHARD_AND_KEY + "labels.npz: expected an archive"),
    "pickled labels": (
        replace_array(own=np.array([{}], dtype=object)),
        SHARD_AND_KEY + "labels.npz: expected an archive of arrays, found Object arrays cannot be loaded",
    ),
    "damaged image": (
        replace_file(".jpg", b"\xff\xd8\xff"),
        SHARD_AND_KEY + "tcp-front.jpg: expected a JPEG image, found no image",
    ),
    "damaged about": (replace_file("about.json", b"{}"), SHARD_AND_KEY + "about.json: scenario: Field required"),
    "no text": (replace_file("instruction.txt", b"\xff"), SHARD_AND_KEY + "instruction.txt: expected UTF-8"),
    "no array": (replace_array(route=None), SHARD_AND_KEY + "labels.npz: expected an array route, found none"),
    "shape": (
        replace_array(expert_plan=np.zeros((5, 2), np.float32)),
        SHARD_AND_KEY + r"labels.npz: expert_plan: expected float32 of shape \(6, 2\), found float32 of shape \(5, 2\)",
    ),
    "type": (
        replace_array(expert_plan=np.zeros((6, 2))),
        SHARD_AND_KEY + r"labels.npz: expert_plan: expected float32 of shape \(6, 2\), found float64",
    ),
    "rows": (
        replace_array(futures=np.zeros((77, 6, 3), np.float32)),
        SHARD_AND_KEY + r"labels.npz: futures: expected float32 of shape \(N, 6, 3\), found float32 of shape \(77",
    ),
}


@pytest.fixture(scope="module")
def tcp_dataset(few: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A few samples with made-up images of `tcp`."""
    folder = copy_dataset(few, tmp_path_factory.mktemp("tcp") / "set")
    add_images(folder, SYSTEMS["tcp"])
    return folder


@pytest.mark.parametrize("name", BROKEN)
def test_damage_is_one_sentence_with_shard_and_key(name: str, tcp_dataset: Path, tmp_path: Path) -> None:
    damage, pattern = BROKEN[name]
    folder = copy_dataset(tcp_dataset, tmp_path / "set")
    damage(folder)
    with pytest.raises(InputError) as caught:
        list(read_samples(folder, SYSTEMS["tcp"]))
    assert re.search(pattern, str(caught.value)) and "\n" not in str(caught.value)
    with pytest.raises(InputError) as again:
        load_arrays(folder, SYSTEMS["tcp"])
    assert str(again.value) == str(caught.value)


def test_a_rig_that_was_not_recorded_is_named(tcp_dataset: Path) -> None:
    with pytest.raises(InputError, match="expected images of the rig vad, which uniad uses, found tcp; `learn data"):
        load_arrays(tcp_dataset, SYSTEMS["uniad"])


def test_a_size_of_another_rig_is_named(tcp_dataset: Path, tmp_path: Path) -> None:
    folder = copy_dataset(tcp_dataset, tmp_path / "set")
    buffer = io.BytesIO()
    Image.new("RGB", (90, 25)).save(buffer, "JPEG")
    replace_file("tcp-front.jpg", buffer.getvalue())(folder)
    with pytest.raises(InputError, match=r"tcp-front\.jpg: expected 450 x 128 pixels, found 90 x 25"):
        list(read_samples(folder, SYSTEMS["tcp"]))


def test_rigs_that_share_images_are_recorded_once() -> None:
    assert parse_rig_names(("uniad", "tcp", "vad")) == ("tcp", "vad")
    assert [find_rig_system(rig).name for rig in ("tcp", "vad", "lmdrive")] == ["tcp", "vad", "lmdrive"]
    with pytest.raises(InputError, match="--rig: expected one of tcp, vad, uniad, lmdrive, found 'vat'; did you mean"):
        parse_rig_names(("vat",))


def test_checksums_of_the_data_set_are_those_of_its_files(dataset: Path) -> None:
    about = json.loads((dataset / DATASET_FILE).read_text())
    assert [one["checksum"] for one in about["shards"]] == [compute_file_checksum(dataset / SHARD)]
