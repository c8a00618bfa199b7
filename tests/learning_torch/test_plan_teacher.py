"""The teacher of plan anchors: what it says about plans by hand, and that a network learns to say it."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from click.testing import CliRunner
from torch import Tensor

from mdrive_sumo.agents.learned.plan_anchors import ANCHORS, build_anchors
from mdrive_sumo.agents.learned.system_spec import SYSTEMS
from mdrive_sumo.cli import main
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.learning.synthetic_samples import build_synthetic_arrays
from mdrive_sumo.learning.training import smoke_test
from mdrive_sumo.learning.training.anchor_losses import compute_anchor_losses
from mdrive_sumo.learning.training.checkpoint import load_checkpoint
from mdrive_sumo.learning.training.export_network import MOST_BYTES, export_network
from mdrive_sumo.learning.training.plan_teacher import extend_route, judge_plans
from mdrive_sumo.learning.training.run_training import TrainingRun, run_training
from mdrive_sumo.learning.training.trainer import Trainer
from mdrive_sumo.learning.training.training_data import TrainingData
from mdrive_sumo.learning.training.training_options import TrainingOptions

TIMES = torch.arange(1, 7) * 0.5
OPTIONS = TrainingOptions(steps=2, batch=2, log_every=1, plan_head="anchors")


def drive(speed: float, acceleration: float = 0.0, aside: float = 0.0) -> Tensor:
    """A plan straight on, which moves aside at an even rate."""
    x = speed * TIMES + acceleration * TIMES * TIMES / 2.0
    return torch.stack((x, aside * TIMES / 3.0), dim=-1)


def describe(
    expert: Tensor, box: tuple[float, ...] = (), velocity: tuple[float, float] = (0.0, 0.0)
) -> dict[str, Tensor]:
    """A straight lane 3.5 m wide, a car at 8 m/s, and one other of 4 x 2 m: x, y, yaw."""
    route = torch.zeros(1, 20, 4)
    route[0, :, 0], route[0, :, 2], route[0, :, 3] = torch.arange(20) * 2.5, 1.75, 8.0
    boxes, futures = torch.full((1, 2, 9), torch.nan), torch.full((1, 2, 6, 3), torch.nan)
    if box:
        boxes[0, 0] = torch.tensor((*box, 4.0, 2.0, 0.0, 0.0, 1.0, 0.0))
        futures[0, 0] = torch.tensor(box)
        futures[0, 0, :, :2] += TIMES[:, None] * torch.tensor(velocity)
    own = torch.tensor([[0.0, 0.0, 0.0, 8.0, 0.0, 0.0]])
    return {"expert_plan": expert[None], "boxes": boxes, "futures": futures, "route": route, "own": own}


@pytest.mark.parametrize(
    ("box", "velocity", "is_good"),
    [
        ((), (0.0, 0.0), True),
        ((20.0, 0.0, 0.0), (0.0, 0.0), False),  # in its way
        ((20.0, 2.0, 0.0), (0.0, 0.0), False),  # its half width and ours and the margin are 2.1 m
        ((20.0, 2.2, 0.0), (0.0, 0.0), True),
        ((20.0, 2.2, math.pi / 2), (0.0, 0.0), False),  # across
        ((31.0, 0.0, 0.0), (0.0, 0.0), True),  # beyond the plan's end
        ((10.0, 10.0, -math.pi / 2), (0.0, -8.0), False),  # crosses, and is there between two points of the plan
        ((-8.0, 0.0, 0.0), (12.0, 0.0), True),  # from behind
    ],
)
def test_a_plan_is_bad_where_a_road_user_will_be(
    box: tuple[float, ...], velocity: tuple[float, float], is_good: bool
) -> None:
    judged = judge_plans(drive(8.0)[None, None], describe(drive(0.0), box, velocity))
    assert judged[0, 0, 0].item() == float(is_good)
    allowed = judge_plans(drive(8.0)[None, None], describe(drive(8.0), box, velocity))
    assert allowed[0, 0].tolist() == [1.0, 1.0, 1.0, 1.0]  # what the expert does


def test_who_stands_is_not_to_blame() -> None:
    labels = describe(drive(8.0), (5.0, -12.0, math.pi / 2), (-1.0, 4.0))
    assert judge_plans(torch.stack((drive(0.0), drive(1.2)))[None], labels)[0, :, 0].tolist() == [1.0, 0.0]


@pytest.mark.parametrize(
    ("plan", "judged"),
    [
        (drive(8.0, aside=0.85), (1.0, 1.0)),  # the lane's room: half its width less half the car's
        (drive(8.0, aside=1.35), (0.5, 1.0)),
        (drive(8.0, aside=4.0), (0.0, 1.0)),
        (drive(4.0), (1.0, 13.0 / 25.0)),  # 12 m of 24 m, a metre of slack each
        (drive(0.0), (1.0, 1.0 / 25.0)),
        (drive(12.0), (1.0, 1.0)),  # no more than the expert
    ],
)
def test_a_plan_stays_in_its_lane_and_gets_on(plan: Tensor, judged: tuple[float, float]) -> None:
    found = judge_plans(plan[None, None], describe(drive(8.0)))[0, 0, 1:3]
    assert found.tolist() == pytest.approx(judged, abs=0.01)


@pytest.mark.parametrize(("acceleration", "good"), [(2.0, 1.0), (-4.0, 1.0), (4.4, 0.5), (-6.05, 0.5)])
def test_comfort_ends_at_the_bounds_of_nuplan(acceleration: float, good: float) -> None:
    """2.4 and -4.05 m/s2; the teacher gives 4 m/s2 until a plan is good for nothing."""
    plan = drive(20.0, acceleration)
    labels = describe(drive(20.0)) | {"own": torch.tensor([[0.0, 0.0, 0.0, 20.0, 0.0, 0.0]])}
    assert judge_plans(plan[None, None], labels)[0, 0, 3].item() == pytest.approx(good, abs=0.01)


def test_a_route_goes_on_straight_beyond_what_is_told_and_beyond_its_goal() -> None:
    route = torch.zeros(2, 4, 4)
    route[0, :, 0] = torch.arange(4)
    route[1, :, 1] = torch.tensor((0.0, 2.0, 2.0, 2.0))
    assert extend_route(route)[:, -1, :2].tolist() == [[103.0, 0.0], [0.0, 102.0]]


def test_the_right_choice_costs_least() -> None:
    arrays = build_synthetic_arrays(SYSTEMS["vad"], 4, seed=1)
    labels = {name: torch.from_numpy(values) for name, values in arrays.items()}
    points = torch.from_numpy(build_anchors().points).float()
    rows = torch.tensor([3, 50, 100, 200])
    labels["expert_plan"] = points[rows]
    judged = judge_plans(points.expand(4, -1, -1, -1), labels)
    right = torch.cat((torch.full((4, ANCHORS, 1), -20.0), 20.0 * (2.0 * judged - 1.0)), dim=-1)
    right[torch.arange(4), rows, 0] = 0.0
    exact = {"anchor_logits": right, "anchor_offsets": torch.zeros(4, ANCHORS, 6, 2)}
    wrong = {"anchor_logits": -right, "anchor_offsets": torch.ones(4, ANCHORS, 6, 2)}
    losses, worse = compute_anchor_losses(exact, labels), compute_anchor_losses(wrong, labels)
    assert all(worse[name] > losses[name] + 0.5 for name in ("choice", "teacher", "offset"))


@pytest.mark.parametrize("system", ["uniad", "lmdrive"])
def test_every_system_learns_anchors_and_is_exported(system: str, tmp_path: Path) -> None:
    """`export_network` compares scores and offsets with PyTorch's."""
    spec = SYSTEMS[system]
    data = TrainingData(spec, build_synthetic_arrays(spec, 4, seed=0), torch.device("cpu"))
    losses = Trainer(system, OPTIONS, torch.device("cpu")).train(data, np.ones(4), tmp_path)
    assert {"choice", "teacher", "offset", "occupancy"} <= set(losses) and "plan" not in losses
    found = export_network(load_checkpoint(tmp_path, system), tmp_path)
    assert found.network.stat().st_size <= MOST_BYTES


@pytest.mark.slow
def test_the_smoke_test_lowers_the_loss_of_anchors(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(smoke_test, "STEPS", 30)  # the first ten and the last ten are compared
    steps = ("--smoke", "--plan-head", "anchors", "--device", "cpu", "--out", str(tmp_path))
    trained = CliRunner().invoke(main, ["learn", "train", "tcp", *steps])
    assert trained.exit_code == 0, trained.output
    found = export_network(load_checkpoint(tmp_path / "smoke", "tcp"), tmp_path)
    assert found.network.stat().st_size <= MOST_BYTES and '"plan_head": "anchors"' in found.manifest.read_text()


def test_a_training_keeps_its_plan_head(tmp_path: Path) -> None:
    arrays = build_synthetic_arrays(SYSTEMS["tcp"], 20, seed=0)
    run = TrainingRun("tcp", replace(OPTIONS, plan_head="waypoints"), "cpu", tmp_path / "first", arrays)
    path = run_training(run, lambda _: None)
    with pytest.raises(InputError, match="--plan-head: expected waypoints, as the training began, found anchors"):
        run_training(replace(run, options=OPTIONS, is_resumed=True), lambda _: None)
    other = replace(run, options=OPTIONS, folder=tmp_path / "second", initial=path)
    with pytest.raises(InputError, match="--init: expected weights with the plan head anchors, found waypoints"):
        run_training(other, lambda _: None)
