"""The fingerprint of a run: everything that makes two runs the same run, and that their results depend on."""

import hashlib
import importlib.util
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from platform import python_version

from mdrive_sumo.agent_process.agent_lookup import CARLA_PREFIX, find_carla_file, split_locator
from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.roads import find_network_folder
from mdrive_sumo.roads.network_file import read_network_file
from mdrive_sumo.runs.journal import Fingerprint
from mdrive_sumo.runs.run_config import RunConfig, config_text
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import Suite, list_packaged_suites
from mdrive_sumo.v2x.comm_settings import format_comm_json

PACKAGES = ("mdrive-sumo", "libsumo", "numpy")


def compute_fingerprint(settings: RunConfig, suite: Suite, scenarios: tuple[Scenario, ...]) -> Fingerprint:
    """Of an evaluation; raises InputError for a network that is not there."""
    packaged = suite.folder == list_packaged_suites().get(settings.suite)
    return {
        "suite": settings.suite if packaged else str(suite.folder.resolve()),
        "suite_checksum": suite.checksum(),
        "networks": _networks_checksum(suite, scenarios),
        "scenario": settings.scenario,
        "agent": resolve_locator(settings.agent),
        "agent_config": config_text(settings.agent_config),
        "agent_code": _agent_checksum(settings.agent),
        "seed": settings.seed,
        "score_mode": settings.score_mode,
        "comm": format_comm_json(settings.comm),
        "agent_clock": settings.clock.text,
        "actors": settings.actors,
        "friction": settings.friction,
        "record": settings.record,
        "code": compute_code_checksum(),
        **read_versions(),
    }


def resolve_locator(agent: str) -> str:
    """The agent as any process will find it: the path of a file is made absolute."""
    if agent in AGENTS:
        return agent
    if (file := find_carla_file(agent)) is not None:
        return f"{CARLA_PREFIX}{file.resolve()}"
    place, name = split_locator(agent)
    return f"{Path(place).resolve()}:{name}" if place.endswith(".py") else agent


def read_versions() -> dict[str, str]:
    """What results depend on."""
    return {"python": python_version()} | {package: version(package) for package in PACKAGES}


def _networks_checksum(suite: Suite, scenarios: tuple[Scenario, ...]) -> str:
    """Over the networks in use, what is beside their roads included."""
    digest = hashlib.sha256()
    for name, home in sorted({(scenario.network, suite.home(scenario.id)) for scenario in scenarios}):
        digest.update(read_network_file(find_network_folder(name, home)).model_dump_json().encode())
    return "sha256:" + digest.hexdigest()


def _agent_checksum(agent: str) -> str:
    """Of the file in which a third-party agent's class is; "" for a built-in one, whose code is `code`."""
    if agent in AGENTS:
        return ""
    if (file := find_carla_file(agent)) is not None:
        return _checksum({str(file): file} if file.is_file() else {})
    place, _ = split_locator(agent)
    if not place.endswith(".py"):
        spec = importlib.util.find_spec(place)
        place = (spec.origin if spec else None) or ""
    return _checksum({place: Path(place)} if place else {})


def compute_code_checksum() -> str:
    """Of this library, so that episodes of two states of its code never mix in one run."""
    root = Path(__file__).parents[1]
    return _checksum({str(path.relative_to(root)): path for path in root.rglob("*.py")})


def _checksum(files: Mapping[str, Path]) -> str:
    digest = hashlib.sha256()
    for name, path in sorted(files.items()):
        digest.update(name.encode() + b"\0" + path.read_bytes())
    return "sha256:" + digest.hexdigest()
