"""Scenarios written by hand: routes by lanes or points, road users with triggers, and the suite folder they go into."""

from mdrive_sumo.worlds.authoring.road_users import after, near, when_at
from mdrive_sumo.worlds.authoring.scenario_builder import ScenarioBuilder

__all__ = ["ScenarioBuilder", "near", "after", "when_at"]
