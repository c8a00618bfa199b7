"""Free distance ahead."""

import numpy as np

LOOK_S = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 2.5])
"""Prediction times; others keep their velocity [s]."""


def free_way(route, s, here, objects, width):
    """Return the distance along the route to the first point occupied now or soon [m]; infinite if there is none."""
    ahead = (s > here) & (s < here + 50.0)
    if not ahead.any() or not len(objects.x):
        return np.inf
    moved = LOOK_S[:, None] * objects.speed
    x = (objects.x + moved * np.cos(objects.yaw)).ravel()
    y = (objects.y + moved * np.sin(objects.yaw)).ravel()
    room = width + np.tile(objects.width, len(LOOK_S)) / 2
    touched = (np.hypot(route[ahead, 0, None] - x, route[ahead, 1, None] - y) < room).any(axis=1)
    return float(s[ahead][touched][0] - here) if touched.any() else np.inf
