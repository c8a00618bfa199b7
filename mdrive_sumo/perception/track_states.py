"""Kalman filters of many tracks at once, as a struct of arrays.

Each track has two filters with two states each, and so closed forms without matrices: position and velocity, the same
variances for x and y (constant velocity, turned by the yaw rate; white acceleration), and yaw and yaw rate.
"""

from dataclasses import dataclass, fields
from typing import Self

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, Int, wrap_angles
from mdrive_sumo.perception.measurements import Measurements
from mdrive_sumo.perception.tracking_parameters import TrackingParameters

MAX_YAW_STEP = 0.5
"""[rad] A larger innovation of the yaw is no turn: the filter starts anew (a pedestrian turns round)."""


@dataclass(slots=True)
class TrackColumns:
    """A struct of arrays; every field is an array with a row per track."""

    def take(self, rows: Int | Bool) -> Self:
        """Return the given rows only."""
        return type(self)(*(getattr(self, field.name)[rows] for field in fields(self)))

    def concat(self, other: Self) -> Self:
        """Return the own rows followed by those of the other."""
        names = [field.name for field in fields(self)]
        return type(self)(*(np.concatenate((getattr(self, name), getattr(other, name))) for name in names))


@dataclass(slots=True)
class TrackStates(TrackColumns):
    """States of N tracks; all arrays are (N,)."""

    x: Float
    y: Float
    vx: Float
    vy: Float
    position: Float
    """[m2] Variance of x and of y,"""
    coupling: Float
    """[m2/s] their covariance with the velocity of the same axis,"""
    velocity: Float
    """[m2/s2] and the variance of that."""
    yaw: Float
    turn_rate: Float
    yaw_variance: Float
    yaw_coupling: Float
    turn_variance: Float
    length: Float
    width: Float

    @classmethod
    def start(cls, new: Measurements, parameters: TrackingParameters) -> Self:
        """Return a track for every measurement."""
        boxes, zero = new.objects, np.zeros(len(new.objects.ids))
        cos, sin = portable.cos_sin(boxes.yaw)
        vx, vy = boxes.speed * cos, boxes.speed * sin
        turn = zero + portable.square(parameters.max_turn_rate / 2)
        position = new.position + new.bias
        return cls(
            boxes.x.copy(), boxes.y.copy(), vx, vy, position, zero, new.speed.copy(), boxes.yaw.copy(), zero.copy(),
            new.yaw.copy(), zero.copy(), turn, boxes.length.copy(), boxes.width.copy(),
        )  # fmt: skip

    def predict(self, seconds: float, parameters: TrackingParameters) -> None:
        """Advance all tracks."""
        moves = portable.hypot(self.vx, self.vy) > parameters.moving_speed
        turn = np.where(moves, self.turn_rate, 0.0) * seconds
        cos, sin = portable.cos_sin(turn / 2)
        vx, vy = cos * self.vx - sin * self.vy, sin * self.vx + cos * self.vy  # the direction of the arc's chord
        self.x, self.y = self.x + vx * seconds, self.y + vy * seconds
        self.vx, self.vy = cos * vx - sin * vy, sin * vx + cos * vy
        self.yaw = wrap_angles(self.yaw + turn)
        self.position, self.coupling, self.velocity = _grow(
            self.position, self.coupling, self.velocity, seconds, parameters.acceleration_sigma
        )
        self.yaw_variance, self.yaw_coupling, self.turn_variance = _grow(
            self.yaw_variance, self.yaw_coupling, self.turn_variance, seconds, parameters.turn_acceleration_sigma
        )

    def correct(self, rows: Int, new: "Correction", parameters: TrackingParameters) -> None:
        """Correct the tracks `rows` (K,), each once, by measurements (K,)."""
        self._correct_position(rows, new)
        self._correct_velocity(rows, new)
        self._correct_yaw(rows, new, parameters)
        self.length[rows] += (new.length - self.length[rows]) / parameters.size_weight
        self.width[rows] += (new.width - self.width[rows]) / parameters.size_weight

    def _correct_position(self, rows: Int, new: "Correction") -> None:
        """Correct by positions whose bias cannot be averaged away: only variance beyond it is reducible.

        A track that is known better than the bias (from own detections) is not moved by it.
        """
        variance, velocity = self.position[rows], self.velocity[rows]
        excess = np.maximum(variance - new.bias, 0.0)
        coupling = self.coupling[rows] * np.sqrt(excess / variance)
        total = excess + new.position
        gain, velocity_gain = excess / total, coupling / total
        dx, dy = new.x - self.x[rows], new.y - self.y[rows]
        self.x[rows] += gain * dx
        self.y[rows] += gain * dy
        self.vx[rows] += velocity_gain * dx
        self.vy[rows] += velocity_gain * dy
        self.position[rows] = variance - gain * excess
        self.coupling[rows] = self.coupling[rows] * (1.0 - gain)
        self.velocity[rows] = velocity - velocity_gain * coupling

    def _correct_velocity(self, rows: Int, new: "Correction") -> None:
        coupling, velocity = self.coupling[rows], self.velocity[rows]
        total = velocity + new.speed
        gain, position_gain = velocity / total, coupling / total
        dvx, dvy = new.vx - self.vx[rows], new.vy - self.vy[rows]
        self.x[rows] += position_gain * dvx
        self.y[rows] += position_gain * dvy
        self.vx[rows] += gain * dvx
        self.vy[rows] += gain * dvy
        self.position[rows] -= position_gain * coupling
        self.coupling[rows] = coupling * (1.0 - gain)
        self.velocity[rows] = velocity * (1.0 - gain)

    def _correct_yaw(self, rows: Int, new: "Correction", parameters: TrackingParameters) -> None:
        step = wrap_angles(new.yaw - self.yaw[rows])
        anew = np.abs(step) > MAX_YAW_STEP
        variance, coupling = self.yaw_variance[rows], self.yaw_coupling[rows]
        total = variance + new.yaw_variance
        gain, turn_gain = np.where(anew, 1.0, variance / total), np.where(anew, 0.0, coupling / total)
        self.yaw[rows] = wrap_angles(self.yaw[rows] + gain * step)
        turn = np.where(anew, 0.0, self.turn_rate[rows] + turn_gain * step)
        self.turn_rate[rows] = np.clip(turn, -parameters.max_turn_rate, parameters.max_turn_rate)
        self.yaw_variance[rows] = np.where(anew, new.yaw_variance, variance * (1.0 - gain))
        self.yaw_coupling[rows] = np.where(anew, 0.0, coupling * (1.0 - gain))
        self.turn_variance[rows] -= turn_gain * coupling

    @property
    def speed(self) -> Float:
        """Return the speeds (N,) [m/s] along the yaw."""
        cos, sin = portable.cos_sin(self.yaw)
        return self.vx * cos + self.vy * sin


def _grow(first: Float, both: Float, second: Float, seconds: float, sigma: float) -> tuple[Float, Float, Float]:
    """Return variance, covariance and variance of a value and its rate after a time of white acceleration."""
    noise, square = sigma * sigma, seconds * seconds
    return (
        first + seconds * (2 * both + seconds * second) + noise * square * square / 4,
        both + seconds * second + noise * square * seconds / 2,
        second + noise * square,
    )


@dataclass(frozen=True, slots=True)
class Correction:
    """What corrects K tracks, one row each; all arrays are (K,), `position` to `speed` variances."""

    x: Float
    y: Float
    vx: Float
    vy: Float
    yaw: Float
    position: Float
    bias: Float
    yaw_variance: Float
    speed: Float
    length: Float
    width: Float

    @classmethod
    def build(cls, rows: Int, new: Measurements, columns: Int) -> "tuple[Int, Correction]":
        """Return tracks, each once, and the means of the measurements `columns` assigned to `rows` (K,), ascending."""
        boxes = new.objects
        yaw, speed = boxes.yaw[columns], boxes.speed[columns]
        cos, sin = portable.cos_sin(yaw)
        states = cls(
            boxes.x[columns], boxes.y[columns], speed * cos, speed * sin, yaw, new.position[columns],
            new.bias[columns], new.yaw[columns], new.speed[columns], boxes.length[columns], boxes.width[columns],
        )  # fmt: skip
        if (rows[1:] != rows[:-1]).all():
            return rows, states
        tracks, first, index = np.unique(rows, return_index=True, return_inverse=True)
        return tracks, states._average(first, index)

    def _average(self, first: Int, index: Int) -> "Correction":
        """Return the means weighted by accuracy; index (K,): row of the result, first: one row of each in this.

        Random errors average out. The mean of the biases is a bound: they have the own car's estimate in common.
        """

        def mean(values: Float, weights: Float) -> Float:
            return np.bincount(index, values * weights) / np.bincount(index, weights)

        places, speeds, yaws = 1 / (self.position + self.bias), 1 / self.speed, 1 / self.yaw_variance
        yaw = self.yaw[first]
        return Correction(
            mean(self.x, places), mean(self.y, places), mean(self.vx, speeds), mean(self.vy, speeds),
            yaw + mean(wrap_angles(self.yaw - yaw[index]), yaws), 1 / np.bincount(index, 1 / self.position),
            mean(self.bias, places), 1 / np.bincount(index, yaws), 1 / np.bincount(index, speeds),
            mean(self.length, places), mean(self.width, places),
        )  # fmt: skip
