"""Obstacles in LiDAR scans: points above the ground, grouped by neighbouring cells, with velocities between scans."""

import numpy as np

SENSOR_M = 2.5
"""Height of the sensor, as by default on a car [m]."""
HEIGHT_M = (0.3, 3.0)
"""Points between these heights above the ground are obstacles [m]."""
REACH_M = 45.0
CELL_M = 1.0
LONGEST_M = 12.0
"""Longer groups are walls: they stand, although their visible part moves."""
STEP_M, SLOWEST = 4.0, 1.0
"""Largest way of a group between two scans [m]; what is slower stands [m/s]."""
LOOK_S = np.arange(0.0, 3.1, 0.25)
"""Times for which obstacles are moved ahead [s]."""


class ObstacleFinder:
    """The obstacles of the last scan: points and velocities in the world frame."""

    def __init__(self, tick_s):
        self.tick_s, self.tick = tick_s, 0
        self.centres = np.zeros((0, 2))
        self.points, self.velocities = np.zeros((0, 2)), np.zeros((0, 2))

    def update(self, tick, own, scan):
        """Take a scan (N, 4) in the frame of the sensor above the own box centre."""
        height = scan[:, 2] + SENSOR_M
        near = (height > HEIGHT_M[0]) & (height < HEIGHT_M[1]) & (np.hypot(scan[:, 0], scan[:, 1]) < REACH_M)
        ahead, left = scan[near, :2].T.astype(float)
        cos, sin = np.cos(own.yaw), np.sin(own.yaw)
        world = np.column_stack([own.x + cos * ahead - sin * left, own.y + sin * ahead + cos * left])
        cells, at = np.unique(np.floor(world / CELL_M).astype(int), axis=0, return_inverse=True)
        group_of_cell = group_cells(cells)
        groups = group_of_cell[at.ravel()]
        points = (cells + 0.5) * CELL_M
        centres = np.array([world[groups == group].mean(axis=0) for group in range(group_of_cell.max(initial=-1) + 1)])
        velocities = self.match(centres.reshape(-1, 2), (tick - self.tick) * self.tick_s)
        for group in range(len(velocities)):
            if np.ptp(points[group_of_cell == group], axis=0).max() > LONGEST_M:
                velocities[group] = 0.0
        self.tick, self.centres = tick, centres.reshape(-1, 2)
        self.points, self.velocities = points, velocities[group_of_cell]

    def match(self, centres, elapsed_s):
        """Return the velocity (M, 2) of each group by its nearest predecessor; 0 without one."""
        found = np.zeros_like(centres)
        if len(centres) and len(self.centres) and elapsed_s > 0:
            away = centres[:, None] - self.centres
            nearest = np.hypot(away[..., 0], away[..., 1]).argmin(axis=1)
            moved = away[np.arange(len(centres)), nearest]
            way = np.hypot(moved[:, 0], moved[:, 1])
            moving = (way < STEP_M) & (way > SLOWEST * elapsed_s)
            found[moving] = moved[moving] / elapsed_s
        return found

    def find_free_way(self, route, s, here, width):
        """Return the distance along the route to the first point that is occupied now or soon [m]."""
        ahead = (s > here + 1.0) & (s < here + REACH_M)
        if not ahead.any() or not len(self.points):
            return np.inf
        places = (self.points + LOOK_S[:, None, None] * self.velocities).reshape(-1, 2)
        gaps = np.hypot(route[ahead, 0, None] - places[:, 0], route[ahead, 1, None] - places[:, 1])
        touched = (gaps < width).any(axis=1)
        return float(s[ahead][touched][0] - here) if touched.any() else np.inf


def group_cells(cells):
    """Return the number of the group of each cell (N, 2): cells that touch, also at a corner, are one group."""
    left = {tuple(cell): i for i, cell in enumerate(cells.tolist())}
    groups = np.zeros(len(cells), dtype=int)
    number = 0
    while left:
        cell, index = left.popitem()
        queue, groups[index] = [cell], number
        while queue:
            x, y = queue.pop()
            for other in ((x + i, y + j) for i in (-1, 0, 1) for j in (-1, 0, 1)):
                if (found := left.pop(other, None)) is not None:
                    groups[found] = number
                    queue.append(other)
        number += 1
    return groups
