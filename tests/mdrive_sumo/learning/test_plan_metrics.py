"""Open-loop metrics, kinds of samples, what is held out, and what is said where PyTorch is missing."""

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from mdrive_sumo.agents.learned.system_spec import SYSTEMS
from mdrive_sumo.cli import main
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.learning import require_torch as requirements
from mdrive_sumo.learning.held_out import check_apart, find_held_out
from mdrive_sumo.learning.plan_metrics import (
    SHARES,
    compute_shares,
    describe_plans,
    measure_controls,
    measure_plans,
    name_kinds,
    predict_constant_velocity,
)
from mdrive_sumo.learning.sample_format import DATASET_FILE, DatasetFile
from mdrive_sumo.learning.synthetic_samples import build_synthetic_arrays


def make_plan(end: tuple[float, float]) -> np.ndarray:
    """A straight plan (6, 2) to a place in 3 s."""
    return np.linspace(0.0, 1.0, 7)[1:, None] * np.array(end)


def test_errors_are_means_of_distances_up_to_each_horizon() -> None:
    """1 m, 2 m, ... 6 m off: over the first 2 points 1.5 m, over all 3.5 m."""
    expert = np.zeros((3, 6, 2), np.float32)
    plans = expert.copy()
    plans[..., 1] = np.arange(1, 7)
    found = measure_plans(plans, expert)
    assert (found["ade_1s_m"], found["fde_1s_m"]) == (1.5, 2.0)
    assert (found["ade_2s_m"], found["ade_3s_m"], found["fde_3s_m"]) == (2.5, 3.5, 6.0)


def test_constant_velocity_goes_on_straight() -> None:
    own = np.zeros((1, 6), np.float32)
    own[0, 2:4] = 1.0, 8.0  # whatever its heading
    assert predict_constant_velocity(own)[0].tolist() == [[4.0 * k, 0.0] for k in range(1, 7)]


@pytest.mark.parametrize(
    ("speed", "end", "kind"),
    [
        (0.0, (0.1, 0.0), "stand"),
        (0.0, (4.0, 0.0), "start"),
        (8.0, (24.0, 0.0), "cruise"),
        (8.0, (10.0, 0.5), "brake"),
        (6.0, (14.0, 5.0), "turn"),
        (1.0, (6.0, 3.0), "start"),
    ],
)
def test_a_sample_is_named_by_what_the_expert_does_next(speed: float, end: tuple[float, float], kind: str) -> None:
    own = np.zeros((1, 6), np.float32)
    own[0, 3] = speed
    arrays = {"own": own, "expert_plan": make_plan(end)[None]}
    assert name_kinds(arrays).tolist() == [kind]
    assert compute_shares(arrays).tolist() == [SHARES[kind]]


def test_the_description_compares_with_constant_velocity() -> None:
    arrays = build_synthetic_arrays(SYSTEMS["tcp"], 12, seed=0)
    off = arrays["expert_plan"].astype(np.float32) + np.float32(1.0)
    found = describe_plans(off, arrays)  # off by 1 m in both directions
    assert found["plan"]["ade_3s_m"] == pytest.approx(2**0.5, rel=1e-6)
    assert found["constant_velocity"]["ade_3s_m"] == pytest.approx(0.0, abs=1e-5)
    assert sum(one["samples"] for one in found["by_kind"].values()) == 12
    assert measure_controls(arrays["expert_control"], arrays["expert_control"])["steer"] == 0.0


def test_whole_places_are_held_out() -> None:
    scenario = np.repeat(np.arange(400), 5).astype(np.int32)
    held_out = find_held_out({"scenario": scenario})
    assert sorted(set(scenario[held_out].tolist())) == [*range(190, 200), *range(390, 400)] and len(held_out) == 100
    assert set(scenario[find_held_out({"scenario": scenario[:125]})].tolist()) == set(range(20, 25)), "the last place"
    assert find_held_out({"scenario": scenario[:50]}).tolist() == [45, 46, 47, 48, 49], "the last scenario of one place"
    with pytest.raises(InputError, match="expected two scenarios or more to hold one out, found fewer; give --val"):
        find_held_out({"scenario": scenario[:5]})


def test_a_later_round_holds_out_the_same_places() -> None:
    first, both = np.arange(200, dtype=np.int32), np.concatenate((np.arange(200), np.arange(600))).astype(np.int32)
    held_out = set(first[find_held_out({"scenario": first})].tolist())
    trained = set(np.delete(both, find_held_out({"scenario": both})).tolist())
    assert held_out and not held_out & trained


def write_about(folder: Path, split: str, seed: int) -> Path:
    folder.mkdir()
    about = DatasetFile(
        program="0", split=split, seed=seed, expert="single", rigs=(), perturbation=1.0, driver="", mix=0.0,
        round=0, requested=4, samples=0, shards=(),
    )  # fmt: skip
    (folder / DATASET_FILE).write_text(about.model_dump_json())
    return folder


def test_what_is_trained_on_does_not_validate(tmp_path: Path) -> None:
    train, more = write_about(tmp_path / "a", "train", 0), write_about(tmp_path / "b", "train", 1)
    val = write_about(tmp_path / "val", "val", 0)
    check_apart([train, more], [val])
    check_apart([tmp_path / "of no interest"], [])
    with pytest.raises(InputError, match=r"--val .*b: expected places that are not trained on, found those of --data"):
        check_apart([train, more], [val, more])


@pytest.mark.parametrize("command", ["train", "export"])
def test_missing_pytorch_is_one_sentence(command: str, monkeypatch: pytest.MonkeyPatch, tmp_path: object) -> None:
    monkeypatch.setattr(requirements, "find_spec", lambda name: None if name == "torch" else object())
    options = ["--checkpoint", "x.pt"] if command == "export" else []
    result = CliRunner().invoke(main, ["learn", command, "tcp", "--out", str(tmp_path), *options])
    assert result.exit_code == 2
    assert "to be installed, found no torch; pip install '.[learn,learned]'" in result.output
