"""TcpNetwork: counterpart of TCP: a trajectory branch that guides a control branch, from the front camera."""

import math

import torch
from torch import Tensor, nn

from mdrive_sumo.agents.learned.system_spec import PLAN_POINTS, SystemSpec
from mdrive_sumo.learning.networks.anchor_head import AnchorHead
from mdrive_sumo.learning.networks.bev_grid import BEV_CHANNELS
from mdrive_sumo.learning.networks.bev_lifting import BevLifting
from mdrive_sumo.learning.networks.blocks import WIDTH, GatedCell, Mlp, flatten_map
from mdrive_sumo.learning.networks.heads import STEP_SCALE_M, WAY_SIZE, OccupancyHead, add_steps, describe_way
from mdrive_sumo.learning.networks.image_encoder import WIDE_WIDTHS, ImageEncoder

HIDDEN = 2 * WIDTH
FEATURES = WIDE_WIDTHS[-1]
CONTROL_STEPS = 4
"""Steps of the control branch, each guided by the trajectory branch at the same step."""


class TcpNetwork(nn.Module):
    """Front camera, speed, command and target points; plan and control. A lifted map is supervised in training only.

    Anchors look at that map and at the states of the trajectory branch, whose own waypoints then only guide control.
    """

    def __init__(self, spec: SystemSpec, plan_head: str) -> None:
        super().__init__()
        self.image = spec.images[0].name
        self.encoder = ImageEncoder(WIDE_WIDTHS, WIDTH)
        self.measure = Mlp(WAY_SIZE, HIDDEN, HIDDEN)
        self.first_look = nn.Linear(HIDDEN, FEATURES)
        self.trajectory = TrajectoryBranch()
        self.control = ControlBranch()
        self.speed = Mlp(FEATURES, WIDTH, 1)
        self.lifting = BevLifting(spec, WIDTH)
        self.occupancy = OccupancyHead()
        self.anchors = BranchAnchors() if plan_head == "anchors" else None

    def forward(self, inputs: dict[str, Tensor], with_auxiliary: bool = False) -> dict[str, Tensor]:
        """Return the plan, `control`; with_auxiliary the speed seen [m/s / 10], occupancy, and the branch's `plan`."""
        fine, coarse = self.encoder(inputs[self.image])
        tokens = flatten_map(coarse[:, 0])
        way = describe_way(inputs)
        measured = self.measure(way)
        pooled = attend(self.first_look(measured), tokens) + tokens.mean(dim=1)
        plan, states = self.trajectory(torch.cat((pooled, measured), dim=-1), way)
        answer = {"plan": plan, "control": self.control(pooled, measured, tokens, states)}
        if self.anchors is None and not with_auxiliary:
            return answer
        lifted = self.lifting([fine])
        if self.anchors is not None:
            answer |= self.anchors(states, lifted, with_auxiliary)
        if with_auxiliary:
            answer["speed"] = self.speed(tokens.mean(dim=1))[:, 0]
            answer["occupancy"] = self.occupancy(lifted)
        else:
            del answer["plan"]  # the branch's, which guides control
        return answer


class BranchAnchors(nn.Module):
    """Anchors that look at the states of the trajectory branch."""

    def __init__(self) -> None:
        super().__init__()
        self.tokens = nn.Linear(HIDDEN, WIDTH)
        self.head = AnchorHead(BEV_CHANNELS)

    def forward(self, states: list[Tensor], maps: Tensor, with_logits: bool) -> dict[str, Tensor]:
        """Return what `AnchorHead` does. states: of each waypoint (batch, HIDDEN)."""
        return self.head(self.tokens(torch.stack(states, dim=1)), maps, with_logits)


class TrajectoryBranch(nn.Module):
    """A recurrent cell that unrolls the waypoints, one after the other."""

    def __init__(self) -> None:
        super().__init__()
        self.start = Mlp(FEATURES + HIDDEN, HIDDEN, HIDDEN)
        self.cell = GatedCell(2 + WAY_SIZE, HIDDEN)
        self.step = Mlp(HIDDEN, WIDTH, 2)

    def forward(self, scene: Tensor, way: Tensor) -> tuple[Tensor, list[Tensor]]:
        """Return the plan (batch, PLAN_POINTS, 2) [m] and the state (batch, HIDDEN) at each of its points."""
        state = self.start(scene)
        point = torch.zeros_like(way[:, :2])
        steps: list[Tensor] = []
        states: list[Tensor] = []
        for _ in range(PLAN_POINTS):
            state = self.cell(torch.cat((point / 20.0, way), dim=-1), state)
            steps.append(self.step(state))
            point = point + steps[-1] * STEP_SCALE_M
            states.append(state)
        return add_steps(torch.stack(steps, dim=1)), states


class ControlBranch(nn.Module):
    """Looks where the trajectory leads: its state and that of the trajectory choose the features of each step."""

    def __init__(self) -> None:
        super().__init__()
        self.start = Mlp(FEATURES + HIDDEN, HIDDEN, HIDDEN)
        self.look = Mlp(2 * HIDDEN, HIDDEN, FEATURES)
        self.cell = GatedCell(FEATURES + HIDDEN, HIDDEN)
        self.answer = Mlp(2 * HIDDEN, WIDTH, 3)

    def forward(self, pooled: Tensor, measured: Tensor, tokens: Tensor, states: list[Tensor]) -> Tensor:
        """Return control (batch, 3): throttle and brake in [0, 1], steer in [-1, 1]."""
        state = self.start(torch.cat((pooled, measured), dim=-1))
        for guide in states[:CONTROL_STEPS]:
            seen = attend(self.look(torch.cat((state, guide), dim=-1)), tokens)
            state = self.cell(torch.cat((seen, measured), dim=-1), state)
        raw = self.answer(torch.cat((state, states[0]), dim=-1)).float()
        return torch.cat((torch.sigmoid(raw[:, :2]), torch.tanh(raw[:, 2:])), dim=-1)


def attend(query: Tensor, tokens: Tensor) -> Tensor:
    """Return the mean (batch, n) of tokens (batch, T, n), weighted by how well they fit a query (batch, n)."""
    scores = torch.matmul(tokens, query[..., None])[..., 0] / math.sqrt(tokens.shape[-1])
    return torch.matmul(torch.softmax(scores, dim=-1)[:, None], tokens)[:, 0]
