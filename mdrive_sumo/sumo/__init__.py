"""SUMO in process: the only package that imports libsumo, and the only one with SUMO's conventions."""

from mdrive_sumo.sumo.sumo_world import SumoWorld

__all__ = ["SumoWorld"]
