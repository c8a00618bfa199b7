"""Sandbox boxes for untrusted programs."""

from mdrive_sumo.agent_process.sandbox.box import Box, BoxReport
from mdrive_sumo.agent_process.sandbox.box_spec import BACKENDS, BoxSpec
from mdrive_sumo.agent_process.sandbox.launch import BoxError
from mdrive_sumo.agent_process.sandbox.layers import GAPS, SandboxLayer, check_layers, examine_layers, shown
from mdrive_sumo.agent_process.sandbox.limits import BoxLimits
from mdrive_sumo.agent_process.sandbox.open_box import open_box

__all__ = [
    "BACKENDS",
    "GAPS",
    "Box",
    "BoxError",
    "BoxLimits",
    "BoxReport",
    "BoxSpec",
    "SandboxLayer",
    "check_layers",
    "examine_layers",
    "open_box",
    "shown",
]
