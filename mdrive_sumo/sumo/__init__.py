"""SUMO in process: the only package that imports libsumo, and the only one with SUMO's conventions."""

from mdrive_sumo.roads.road_map import import_sumolib

import_sumolib()  # before libsumo does, which would import pyproj with it

from mdrive_sumo.sumo.sumo_world import SumoWorld  # noqa: E402

__all__ = ["SumoWorld"]
