"""Scenario families of the hard tier: sound scenarios from any point, equal ones from equal points, bounds refused."""

import random
from collections.abc import Iterator

import pytest

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import boxes_overlap, boxes_corners
from mdrive_sumo.generate.hard.families import FAMILIES
from mdrive_sumo.generate.hard.family import BUCKET, FamilyCandidate, ScenarioFamily
from mdrive_sumo.generate.network_features import is_hard_tier
from mdrive_sumo.generate.pipeline import ProposalRejected
from mdrive_sumo.generate.validation.spawn_overlaps import find_spawn_overlaps
from mdrive_sumo.roads import find_network_folder, load_road_map
from mdrive_sumo.scenario.checks import check_scenario
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import load_suite
