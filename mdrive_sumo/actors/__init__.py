"""Scripted road users: what a scenario authors beside SUMO's traffic, moved in Python from frame to frame."""

from mdrive_sumo.actors.scripted_actors import ActorMode, ScriptedActors

__all__ = ["ActorMode", "ScriptedActors"]
