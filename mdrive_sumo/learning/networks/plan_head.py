"""PlanHead: waypoints from tokens of the scene and from what navigation says."""

import torch
from torch import Tensor, nn

from mdrive_sumo.agents.learned.system_spec import NAVIGATION_SIZE, PLAN_POINTS, ROUTE_POINTS
from mdrive_sumo.learning.networks.blocks import WIDTH, AttentionLayer, Mlp

STEP_SCALE_M = 4.0
"""[m] Between two waypoints at 8 m/s."""
ROUTE_SCALES = (20.0, 20.0, 2.0, 10.0)
"""Of x, y, half lane width [m] and speed limit [m/s] of a route point."""


class PlanHead(nn.Module):
    """One query for each waypoint looks at the tokens; steps between waypoints are summed."""

    def __init__(self, uses_route: bool, extra_inputs: int = 0) -> None:
        super().__init__()
        route = 4 * ROUTE_POINTS if uses_route else 0
        self.goal = Mlp(NAVIGATION_SIZE + route + extra_inputs, 2 * WIDTH, WIDTH)
        self.times = nn.Parameter(0.5 * torch.randn(PLAN_POINTS, WIDTH))
        self.look = nn.ModuleList([AttentionLayer() for _ in range(3)])
        self.among = AttentionLayer()
        self.step = nn.Sequential(nn.LayerNorm(2 * WIDTH), Mlp(2 * WIDTH, WIDTH, 2))

    def forward(self, tokens: Tensor, navigation: Tensor, *more: Tensor) -> Tensor:
        """Return the plan (batch, PLAN_POINTS, 2) [m, ego frame].

        tokens: (batch, T, WIDTH). navigation: (batch, NAVIGATION_SIZE). more: vectors (batch, n), a route first.
        """
        goal = self.goal(torch.cat((navigation, *more), dim=-1))
        queries = self.times + goal[:, None]
        for layer in self.look:
            queries = layer(queries, tokens)
        queries = self.among(queries, queries)
        steps = self.step(torch.cat((queries, goal[:, None].expand_as(queries)), dim=-1))
        return add_steps(steps)


def add_steps(steps: Tensor) -> Tensor:
    """Return points (batch, n, 2) [m] from the steps between them, in units of STEP_SCALE_M."""
    return torch.cumsum(steps.float(), dim=1) * STEP_SCALE_M


def scale_route(route: Tensor) -> Tensor:
    """Return a route (batch, ROUTE_POINTS, 4) as a vector of numbers about 1."""
    return (route / route.new_tensor(ROUTE_SCALES)).flatten(1)
