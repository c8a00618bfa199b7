"""`mdrive-sumo schema`."""

import json
from collections.abc import Callable, Mapping
from typing import Any

import click

from mdrive_sumo import contract
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.episode import build_episode_schema
from mdrive_sumo.generate.proposal import Proposal
from mdrive_sumo.learning.sample_format import build_training_data_schema
from mdrive_sumo.open_loop import OpenLoopResults
from mdrive_sumo.roads import NetworkFile
from mdrive_sumo.scenario.reference_times import ReferenceTimesFile
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import SuiteFile
from mdrive_sumo.scoring import build_results_schema
from mdrive_sumo.study.human.human_study_plan import HumanStudyPlan
from mdrive_sumo.study.need_certificate import NeedCertificateFile

SCHEMAS: Mapping[str, Callable[[], dict[str, Any]]] = {
    "results": build_results_schema,
    "contract": contract.schema,
    "scenario": Scenario.model_json_schema,
    "network": NetworkFile.model_json_schema,
    "proposal": Proposal.model_json_schema,
    "suite": SuiteFile.model_json_schema,
    "reference-times": ReferenceTimesFile.model_json_schema,
    "need": NeedCertificateFile.model_json_schema,
    "episode": build_episode_schema,
    "open-loop": OpenLoopResults.model_json_schema,
    "training-data": build_training_data_schema,
    "human-study-plan": HumanStudyPlan.model_json_schema,
}


@click.command("schema")
@click.argument("what", type=click.Choice(tuple(SCHEMAS)))
def command(what: str) -> None:
    """Print a file format, or the contract between benchmark and agent, as JSON.

    Files are described in JSON Schema; the contract by its message types with their fields, a recording (episode)
    by its arrays and the JSON Schema of its header.
    """
    echo(json.dumps(SCHEMAS[what](), indent=2))
