"""Controllers, which turn a plan into pedals and steering.

A controller belongs to one CAV and one episode, because the windows of its PIDs are its state; it runs on every tick.
"""

from mdrive_sumo.vehicle.control.controllers import CONTROLLERS, ControllerFactory
from mdrive_sumo.vehicle.control.plan_reader import Controller, round_control

__all__ = ["CONTROLLERS", "Controller", "ControllerFactory", "round_control"]
