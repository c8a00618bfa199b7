"""Worlds: the one factory of places, traffic and encounters that suites, seasons, the hard tier and training draw from.

Everything is drawn from a version and a seed: the same ones make the same bytes on every machine.

    import mdrive_sumo as md

    world = md.worlds.load("old_town")
    draft = world.new_scenario("left_turn")
    draft.add_cav("south_in_1 -45 > west_out_1 30", "red")
    draft.add_cav("north_in_1 -40 > south_out_1 30", "blue")
    draft.add_pedestrian((-40.0, -20.0), (-46.0, -8.0), when=md.worlds.near("red", 20.0))
    draft.save("my_suite")
"""

from mdrive_sumo.worlds.authoring import ScenarioBuilder, after, near, when_at
from mdrive_sumo.worlds.world import World, draw, load

__all__ = ["ScenarioBuilder", "World", "after", "draw", "load", "near", "when_at"]
