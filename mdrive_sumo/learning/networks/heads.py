"""Heads of the networks: road users, lanes, occupancy and the plan from features of the scene.

Road users are a dense map of centres, boxes and futures, as CenterNet: no matching is needed. Lanes are a few polylines
(vectorised map elements).
"""

from collections.abc import Mapping

import torch
from torch import Tensor, nn
from torch.nn import functional

from mdrive_sumo.agents.learned.navigation import SPEED_SCALE
from mdrive_sumo.agents.learned.system_spec import (
    LIDAR_CELLS,
    LIMIT_ROWS,
    NAVIGATION_SIZE,
    PLAN_POINTS,
)
from mdrive_sumo.learning.networks.anchor_head import AnchorHead
from mdrive_sumo.learning.networks.bev_grid import BEV_AHEAD_M, BEV_CELL_M, BEV_CELLS, BEV_CHANNELS, BEV_LEFT_M
from mdrive_sumo.learning.networks.bev_memory import to_grid
from mdrive_sumo.learning.networks.blocks import WIDTH, AttentionLayer, ConvBlock, Mlp, flatten_map
from mdrive_sumo.learning.sample_format import LANE_POINTS

BOX_NUMBERS = 7
"""dx, dy [m, from the cell's centre], cos, sin of the yaw, length, width [m / 5], speed [m/s / 10]."""
FUTURE_NUMBERS = 2 * PLAN_POINTS
"""x, y [m / 10] of the centre at each time of the plan, from where it is now."""
QUERIES = 16


class AgentsHead(nn.Module):
    """A logit for a centre and the numbers of a box in each cell of the grid."""

    def __init__(self, inputs: int = BEV_CHANNELS) -> None:
        super().__init__()
        self.trunk = ConvBlock(inputs, BEV_CHANNELS)
        self.centre = nn.Conv2d(BEV_CHANNELS, 1, 1)
        self.numbers = nn.Conv2d(BEV_CHANNELS, BOX_NUMBERS + FUTURE_NUMBERS, 1)
        assert self.centre.bias is not None
        nn.init.constant_(self.centre.bias, -4.0)

    def forward(self, bev: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return features, logits (batch, 1, cells, cells) and numbers (batch, BOX_NUMBERS + FUTURE_NUMBERS, ...)."""
        features = self.trunk(bev)
        return features, self.centre(features), self.numbers(features)


class AgentQueries(nn.Module):
    """Vectorised agents: one query for each of the QUERIES likeliest centres."""

    centres: Tensor

    def __init__(self) -> None:
        super().__init__()
        rows = torch.arange(BEV_CELLS).repeat_interleave(BEV_CELLS)
        columns = torch.arange(BEV_CELLS).repeat(BEV_CELLS)
        x, y = BEV_AHEAD_M - (rows + 0.5) * BEV_CELL_M, BEV_LEFT_M - (columns + 0.5) * BEV_CELL_M
        self.register_buffer("centres", torch.stack((x, y), dim=-1) / 10.0, persistent=False)
        self.embed = Mlp(BEV_CHANNELS + BOX_NUMBERS + FUTURE_NUMBERS + 3, WIDTH, WIDTH)

    def forward(self, features: Tensor, logits: Tensor, numbers: Tensor) -> Tensor:
        """Return queries (batch, QUERIES, WIDTH) from what AgentsHead returned."""
        score, cells = logits.flatten(1).topk(QUERIES, dim=1)
        cell_tokens = torch.cat((flatten_map(features), flatten_map(numbers)), dim=-1)
        picked = cell_tokens.gather(1, cells[..., None].expand(-1, -1, cell_tokens.shape[-1]))
        places = self.centres.to(picked.dtype)[cells]
        likely = torch.sigmoid(score)[..., None].to(picked.dtype)
        return self.embed(torch.cat((picked, places, likely), dim=-1)) * likely


MAP_QUERIES = 12
MAP_SCALE_M = 10.0
"""[m] Of an answer of 1: outputs of a fresh network are of that size."""


class MapHead(nn.Module):
    """Learned queries look at the bird's-eye tokens; each answers one polyline and whether there is such a lane."""

    def __init__(self) -> None:
        super().__init__()
        self.queries = nn.Parameter(torch.randn(MAP_QUERIES, WIDTH))
        self.look = AttentionLayer()
        self.lines = Mlp(WIDTH, WIDTH, 2 * LANE_POINTS + 1)

    def forward(self, tokens: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return queries (batch, MAP_QUERIES, WIDTH), lines (..., LANE_POINTS, 2) [m, ego frame] and logits (...)."""
        queries = self.look(self.queries.expand(tokens.shape[0], -1, -1), tokens)
        answer = self.lines(queries)
        lines = answer[..., :-1].unflatten(-1, (LANE_POINTS, 2)) * MAP_SCALE_M
        return queries, lines, answer[..., -1]


TIMES = 1 + PLAN_POINTS
"""Now, and at each time of the plan."""
FINER = LIDAR_CELLS // BEV_CELLS


class OccupancyHead(nn.Module):
    """Logits on the 64 x 64 grid from features on the 32 x 32 grid."""

    def __init__(self, inputs: int = BEV_CHANNELS) -> None:
        super().__init__()
        self.layers = nn.Sequential(ConvBlock(inputs, BEV_CHANNELS), nn.Conv2d(BEV_CHANNELS, TIMES * FINER * FINER, 1))
        _start_rare(self.layers[-1])

    def forward(self, bev: Tensor) -> Tensor:
        """Return logits (batch, TIMES, LIDAR_CELLS, LIDAR_CELLS)."""
        return functional.pixel_shuffle(self.layers(bev), FINER)


def _start_rare(layer: nn.Module) -> None:
    """Start with a probability of 5 % everywhere: most cells are empty."""
    assert isinstance(layer, nn.Conv2d) and layer.bias is not None
    nn.init.constant_(layer.bias, -3.0)


def sample_occupancy(occupancy: Tensor, x: Tensor, y: Tensor) -> Tensor:
    """Return values (batch, T, P) of maps (batch, T, cells, cells) at places x, y (batch, T, P) [m, ego frame].

    Bilinear; zero outside of the maps.
    """
    column, row = to_grid(x, y)
    batch, times, points = x.shape
    place = torch.stack((column, row), dim=-1).reshape(batch * times, 1, points, 2)
    maps = occupancy.reshape(batch * times, 1, *occupancy.shape[2:])
    return functional.grid_sample(maps, place, align_corners=False).reshape(batch, times, points)


STEP_SCALE_M = 4.0
"""[m] Between two waypoints at 8 m/s."""
ROUTE_SCALES = (20.0, 20.0, 2.0, 10.0)
"""Divisors of x, y, half lane width [m] and speed limit [m/s] of a route point."""


WAY_SIZE = NAVIGATION_SIZE + len(LIMIT_ROWS)


def describe_way(inputs: Mapping[str, Tensor]) -> Tensor:
    """Return navigation and allowed speeds (batch, WAY_SIZE) as numbers about 1."""
    return torch.cat((inputs["navigation"], inputs["limits"] / SPEED_SCALE), dim=-1)


class PlanQueries(nn.Module):
    """One query for each waypoint looks at the tokens of the scene, then at the others."""

    def __init__(self, goal_inputs: int, looks: int) -> None:
        """goal_inputs: numbers of the vector that says where to go. looks: layers."""
        super().__init__()
        self.goal = Mlp(goal_inputs, 2 * WIDTH, WIDTH)
        self.times = nn.Parameter(0.5 * torch.randn(PLAN_POINTS, WIDTH))
        self.look = nn.ModuleList([AttentionLayer() for _ in range(looks)])
        self.among = AttentionLayer()

    def ask(self, tokens: Tensor, goal: Tensor) -> tuple[Tensor, Tensor]:
        """Return queries (batch, PLAN_POINTS, WIDTH) and goal (batch, WIDTH); see `forward` of the heads."""
        goal = self.goal(goal)
        queries = self.times + goal[:, None]
        for layer in self.look:
            queries = layer(queries, tokens)
        return self.among(queries, queries), goal


class WaypointsHead(PlanQueries):
    """Each query answers the step to its waypoint; steps are summed."""

    def __init__(self, goal_inputs: int) -> None:
        super().__init__(goal_inputs, looks=3)
        self.step = nn.Sequential(nn.LayerNorm(2 * WIDTH), Mlp(2 * WIDTH, WIDTH, 2))

    def forward(self, tokens: Tensor, goal: Tensor, maps: Tensor, with_auxiliary: bool) -> dict[str, Tensor]:  # noqa: ARG002
        """Return `plan` (batch, PLAN_POINTS, 2) [m, ego frame].

        tokens: (batch, T, WIDTH). goal: (batch, goal_inputs). maps: (batch, channels, cells, cells), for anchors.
        """
        queries, goal = self.ask(tokens, goal)
        return {"plan": add_steps(self.step(torch.cat((queries, goal[:, None].expand_as(queries)), dim=-1)))}


class AnchorPlanHead(PlanQueries):
    """The queries are what anchors look at; one look at the tokens is theirs."""

    def __init__(self, goal_inputs: int, channels: int) -> None:
        super().__init__(goal_inputs, looks=2)
        self.anchors = AnchorHead(channels)

    def forward(self, tokens: Tensor, goal: Tensor, maps: Tensor, with_auxiliary: bool) -> dict[str, Tensor]:
        """Return what `AnchorHead` does, with logits for losses; arguments as of `WaypointsHead`."""
        queries, goal = self.ask(tokens, goal)
        return self.anchors(torch.cat((queries, goal[:, None]), dim=1), maps, with_logits=with_auxiliary)


def build_plan_head(plan_head: str, goal_inputs: int, channels: int) -> WaypointsHead | AnchorPlanHead:
    """Return a head of `system_spec.PLAN_HEADS`; channels: of its maps."""
    return AnchorPlanHead(goal_inputs, channels) if plan_head == "anchors" else WaypointsHead(goal_inputs)


def add_steps(steps: Tensor) -> Tensor:
    """Return points (batch, n, 2) [m] from the steps between them, in units of STEP_SCALE_M."""
    return torch.cumsum(steps.float(), dim=1) * STEP_SCALE_M


def scale_route(route: Tensor) -> Tensor:
    """Return a route (batch, ROUTE_POINTS, 4) as a vector of numbers about 1."""
    return (route / route.new_tensor(ROUTE_SCALES)).flatten(1)
