"""Sandbox boxes for untrusted programs."""

from mdrive_sumo.agent_process.sandbox.box import Box, BoxKilledError, BoxReport
from mdrive_sumo.agent_process.sandbox.box_spec import BACKENDS, BoxSpec
from mdrive_sumo.agent_process.sandbox.kernel_trial import (
    AUTO,
    OWN_KERNEL,
    SHARED_KERNEL,
    KernelTrial,
    check_shared_kernel,
    choose_backend,
    try_own_kernel,
)
from mdrive_sumo.agent_process.sandbox.launch import BoxError
from mdrive_sumo.agent_process.sandbox.layers import (
    GAPS,
    SandboxLayer,
    check_layers,
    examine_backend,
    examine_layers,
    list_shown_paths,
)
from mdrive_sumo.agent_process.sandbox.limits import BoxLimits
from mdrive_sumo.agent_process.sandbox.open_box import open_box

__all__ = [
    "AUTO",
    "BACKENDS",
    "GAPS",
    "OWN_KERNEL",
    "SHARED_KERNEL",
    "Box",
    "BoxError",
    "BoxKilledError",
    "BoxLimits",
    "BoxReport",
    "BoxSpec",
    "KernelTrial",
    "SandboxLayer",
    "check_layers",
    "check_shared_kernel",
    "choose_backend",
    "examine_backend",
    "examine_layers",
    "open_box",
    "list_shown_paths",
    "try_own_kernel",
]
