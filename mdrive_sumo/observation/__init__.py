"""What a CAV is told: the briefing before the first tick, then observations. Only what was declared is computed."""

from mdrive_sumo.observation.briefing import briefing
from mdrive_sumo.observation.roadside import Roadside
from mdrive_sumo.observation.senses import Senses, scene_of

__all__ = ["Roadside", "Senses", "briefing", "scene_of"]
