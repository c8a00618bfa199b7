"""Suites through worker processes into results: pool, journal, resume."""

from mdrive_sumo.suite.pool import available_cores
from mdrive_sumo.suite.preparation import Prepared, prepare
from mdrive_sumo.suite.run import RESULTS_FILE, Progress, evaluate
from mdrive_sumo.suite.settings import Settings, load_agent_config

__all__ = [
    "Prepared",
    "Progress",
    "RESULTS_FILE",
    "Settings",
    "available_cores",
    "evaluate",
    "load_agent_config",
    "prepare",
]
