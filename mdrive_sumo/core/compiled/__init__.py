"""The compiled layer: C twins of functions on which an episode spends its time, with the same bits."""

from mdrive_sumo.core.compiled.twins import LAYER, PROBLEM, REFERENCES, SWITCH, USED_LAYER, format_notice, twin

__all__ = ["LAYER", "PROBLEM", "REFERENCES", "SWITCH", "USED_LAYER", "format_notice", "twin"]
