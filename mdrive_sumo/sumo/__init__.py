"""SUMO in process: every SUMO quirk lives in this package, and nothing else imports libsumo."""

from mdrive_sumo.sumo.sumo_world import SumoWorld

__all__ = ["SumoWorld"]
