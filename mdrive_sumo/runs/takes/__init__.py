"""Takes: drives of one scenario by people, stored as ordinary runs of the agent `human`.

The driver of each CAV, and what people do, is in the recording (`loop.human_actions`): `verify` can drive a take again.
"""

from mdrive_sumo.contract.human_options import HUMAN
from mdrive_sumo.loop.human_actions import (
    RECORDING,
    Action,
    ActionSource,
    DriverChoice,
    check_control,
    check_text,
    make_leaving,
)
from mdrive_sumo.loop.human_driver import MAX_CHANGES, HumanDriver
from mdrive_sumo.loop.recorded_actions import RecordedActions
from mdrive_sumo.runs.open_agents import open_human_driver
from mdrive_sumo.runs.takes.observe_take import ObservedTake, is_take, observe_take
from mdrive_sumo.runs.takes.take_run import make_human_spec, prepare_take, write_take

__all__ = [
    "HUMAN",
    "MAX_CHANGES",
    "RECORDING",
    "Action",
    "ActionSource",
    "DriverChoice",
    "HumanDriver",
    "ObservedTake",
    "RecordedActions",
    "check_control",
    "check_text",
    "is_take",
    "make_human_spec",
    "make_leaving",
    "observe_take",
    "open_human_driver",
    "prepare_take",
    "write_take",
]
