"""Scripted actors: road users and objects that the scenario file moves, advanced in Python tick by tick."""

from mdrive_sumo.actors.scripted_actors import ActorMode, ScriptedActors

__all__ = ["ActorMode", "ScriptedActors"]
