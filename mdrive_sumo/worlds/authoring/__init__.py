"""Scenarios written by hand: routes by lanes or points, road users with triggers, and the suite folder they go into."""

from mdrive_sumo.worlds.authoring.scenario_builder import ScenarioBuilder
from mdrive_sumo.worlds.authoring.triggers import after, near, when_at

__all__ = ["ScenarioBuilder", "near", "after", "when_at"]
