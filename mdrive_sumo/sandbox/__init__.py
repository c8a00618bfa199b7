"""Boxes for programs that nobody trusts."""

from mdrive_sumo.sandbox.box import Box, BoxReport
from mdrive_sumo.sandbox.launch import BoxError
from mdrive_sumo.sandbox.layers import GAPS, Layer, check_layers, layers, shown
from mdrive_sumo.sandbox.limits import BoxLimits
from mdrive_sumo.sandbox.opening import open_box
from mdrive_sumo.sandbox.spec import BACKENDS, BoxSpec

__all__ = [
    "BACKENDS",
    "GAPS",
    "Box",
    "BoxError",
    "BoxLimits",
    "BoxReport",
    "BoxSpec",
    "Layer",
    "check_layers",
    "layers",
    "open_box",
    "shown",
]
