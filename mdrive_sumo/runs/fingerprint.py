"""The fingerprint of a run: everything that makes two runs the same run, and that their results depend on."""

import hashlib
from importlib.metadata import version
from pathlib import Path
from platform import python_version

from mdrive_sumo.core.checksum import compute_files_checksum
from mdrive_sumo.roads import find_network_folder
from mdrive_sumo.roads.network_file import read_network_file
from mdrive_sumo.runs.journal import Fingerprint
from mdrive_sumo.runs.run_config import RunConfig
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import Suite, list_packaged_suites

PACKAGES = ("mdrive-sumo", "libsumo", "numpy")


def compute_fingerprint(config: RunConfig, suite: Suite, scenarios: tuple[Scenario, ...]) -> Fingerprint:
    """Return the fingerprint of an evaluation. Raises InputError for a missing network."""
    is_packaged = suite.folder == list_packaged_suites().get(config.suite)
    return {
        **config.to_dict(),
        "suite": config.suite if is_packaged else str(suite.folder.resolve()),
        "suite_checksum": suite.checksum(),
        "networks": compute_networks_checksum(suite, scenarios),
        "agent_code": config.agent.code_checksum(),
        **({"others_code": config.others.agent.code_checksum()} if config.others else {}),
        "code": compute_code_checksum(),
        **read_versions(),
    }


def read_versions() -> dict[str, str]:
    """Return the versions of the packages that results depend on, by name."""
    return {"python": python_version()} | {package: version(package) for package in PACKAGES}


def compute_code_checksum() -> str:
    """Return the checksum of this library: episodes of two states of its code never mix in one run."""
    root = Path(__file__).parents[1]
    return compute_files_checksum({str(path.relative_to(root)): path for path in root.rglob("*.py")})


def compute_networks_checksum(suite: Suite, scenarios: tuple[Scenario, ...]) -> str:
    """Return the checksum of the networks in use, with the files beside their roads."""
    digest = hashlib.sha256()
    for name, home in sorted({(scenario.network, suite.find_folder(scenario.id)) for scenario in scenarios}):
        digest.update(read_network_file(find_network_folder(name, home)).model_dump_json().encode())
    return "sha256:" + digest.hexdigest()
