"""The fingerprint of a run: everything that makes two runs the same run, and that their results depend on."""

import hashlib
import json
import os
from collections.abc import Iterable, Iterator
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from platform import python_version
from typing import NamedTuple

from mdrive_sumo.agents.learned.model_weights import WEIGHTS_FOLDER
from mdrive_sumo.core.checksum import compute_files_checksum
from mdrive_sumo.core.compiled.sources import KINDS as LAYER_SOURCES
from mdrive_sumo.core.plug_ins import PlugInKind, identify_plug_ins
from mdrive_sumo.core.version import __version__
from mdrive_sumo.roads import find_network_folder
from mdrive_sumo.roads.network_file import read_network_file
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.fingerprint_paths import hide_paths
from mdrive_sumo.runs.journal import Fingerprint
from mdrive_sumo.runs.run_config import RunConfig
from mdrive_sumo.scenario.packaged_suites import name_packaged_suite
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.season import write_stored_name
from mdrive_sumo.scenario.suite import Suite

PACKAGES = ("libsumo", "numpy")
"""Besides mdrive-sumo itself: what else decides the bits of an episode."""
SOURCES = (".py", *LAYER_SOURCES)
"""Kinds of files whose contents are the state of the code: Python, and what the compiled layer is built from."""
PACKAGE = Path(__file__).parents[1]
WITHOUT_SOURCES = (str(PACKAGE / "scenarios"),)
"""Most folders of the package: data only. What a run takes from there is in the checksum of its suite."""
FILES_KEYS = ("agent_files", "others_files")
"""Where a fingerprint has the checksums of the files that options of the agents of a run name, in their order."""
PLUG_INS_KEY = "plug_ins"
"""Where a fingerprint has the plug-ins of other packages that a run depends on, as JSON; absent without any."""
ONNX_RUNTIME = ("onnxruntime", "onnxruntime-gpu")
"""Packages that hold it: one of them is installed."""


def compute_fingerprint(config: RunConfig, suite: Suite, scenarios: tuple[Scenario, ...]) -> Fingerprint:
    """Return the fingerprint of an evaluation. Raises InputError for a missing network."""
    folder = config.find_folder(suite.name)
    packaged = name_packaged_suite(suite.folder)
    place = write_stored_name(packaged) if packaged else str(suite.folder.resolve())
    return {
        **hide_paths({**config.to_dict(), "suite": place}, folder),
        "suite_checksum": suite.checksum(),
        "networks": compute_networks_checksum(suite, scenarios),
        "agent_code": config.agent.code_checksum(),
        **({"others_code": config.others.agent.code_checksum()} if config.others else {}),
        **hash_option_files(config),
        "code": compute_code_checksum(),
        **({PLUG_INS_KEY: json.dumps(plug_ins)} if (plug_ins := identify_run_plug_ins(config)) else {}),
        **read_versions(config.agents),
    }


def identify_run_plug_ins(config: RunConfig) -> dict[str, str]:
    """Return package, version and checksum of the plug-ins that a run depends on, by "KIND NAME".

    These are all metrics, and its agents and its suite if they are plug-ins.
    """
    agents = [plug_in.name for agent in config.agents if (plug_in := agent.plug_in) is not None]
    return {
        **identify_plug_ins(PlugInKind.METRICS),
        **identify_plug_ins(PlugInKind.AGENTS, agents),
        **identify_plug_ins(PlugInKind.SCENARIO_SOURCES, [config.suite]),
    }


def hash_option_files(config: RunConfig) -> dict[str, str]:
    """Return the checksum of each agent whose options name files, such as weights of a training of one's own."""
    checksums = {key: agent.files_checksum() for key, agent in zip(FILES_KEYS, config.agents, strict=False)}
    return {key: checksum for key, checksum in checksums.items() if checksum}


def read_versions(agents: Iterable[AgentSpec] = ()) -> dict[str, str]:
    """Return the versions of the packages that results depend on, by name; that of ONNX Runtime if an agent learned."""
    versions = {"python": python_version(), "mdrive-sumo": __version__}
    versions |= {package: version(package) for package in PACKAGES}
    if any(agent.is_learned for agent in agents):
        versions[ONNX_RUNTIME[0]] = _read_onnx_runtime_version()
    return versions


def _read_onnx_runtime_version() -> str:
    for package in ONNX_RUNTIME:
        try:
            return version(package)
        except PackageNotFoundError:
            continue
    return ""


def compute_code_checksum() -> str:
    """Return the checksum of this library: episodes of two states of its code never mix in one run.

    Packaged weights are part of it, by their manifests, which hold the checksums that loading compares.
    """
    states = (*_list_states(PACKAGE, SOURCES), *_list_states(WEIGHTS_FOLDER, (".json",)))
    return _compute_checksum_of_states(tuple(sorted(states)))


class _FileState(NamedTuple):
    """What changes with the content of a file; no program can set the time of its last change of status."""

    path: str
    size: int
    modified_ns: int
    status_changed_ns: int
    inode: int


def _list_states(folder: Path | str, kinds: tuple[str, ...]) -> Iterator[_FileState]:
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir(follow_symlinks=False):
                if entry.name == "__pycache__" or entry.path in WITHOUT_SOURCES:
                    continue
                yield from _list_states(entry.path, kinds)
            elif entry.name.endswith(kinds):
                status = entry.stat()
                yield _FileState(entry.path, status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino)


@lru_cache(maxsize=2)  # to read 600 files takes several times as long as to ask for their states
def _compute_checksum_of_states(states: tuple[_FileState, ...]) -> str:
    paths = [Path(state.path) for state in states]
    return compute_files_checksum({str(path.relative_to(PACKAGE)): path for path in paths})


def compute_networks_checksum(suite: Suite, scenarios: tuple[Scenario, ...]) -> str:
    """Return the checksum of the networks in use, with the files beside their roads."""
    digest = hashlib.sha256()
    for name, home in sorted({(scenario.network, suite.find_folder(scenario.id)) for scenario in scenarios}):
        digest.update(read_network_file(find_network_folder(name, home)).model_dump_json().encode())
    return "sha256:" + digest.hexdigest()
