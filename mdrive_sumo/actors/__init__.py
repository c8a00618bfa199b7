"""Scripted road users: what a scenario authors beside SUMO's traffic, moved in Python from frame to frame."""

from mdrive_sumo.actors.cast import ActorMode, Cast
from mdrive_sumo.actors.crowd import Crowd

__all__ = ["ActorMode", "Cast", "Crowd"]
