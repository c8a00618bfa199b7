"""Run a user's own agent in a box: `eval --sandbox`."""

import sys
import sysconfig
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

from mdrive_sumo.agent_process.agent_lookup import find_carla_file, split_locator
from mdrive_sumo.agent_process.child_process import AGENT_FOLDER, PACKAGE, AgentBox
from mdrive_sumo.agent_process.sandbox import BoxLimits, check_layers
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.roads import list_packaged_networks
from mdrive_sumo.runs.agent_spec import AgentSpec

REQUIRED_LAYERS = ("namespaces", "read-only", "privileges", "seccomp", "rlimits")
"""The layers of a box that a plain user opens."""
LOCAL_BOX_LIMITS = BoxLimits(memory_bytes=4 * 2**30, processes=256, cpu_s=3600)
"""So large that an agent that drives without a box drives in one too; a challenge has smaller ones."""


def list_hidden_folders(*more: Path) -> tuple[Path, ...]:
    """Return the folders that a boxed agent must not read: packaged scenarios and networks, our history, and others."""
    networks = {folder.parent for folder in list_packaged_networks().values()}
    return tuple(path.resolve() for path in (PACKAGE / "scenarios", *networks, PACKAGE.parent / ".git", *more))


def box_agent(spec: AgentSpec, hidden: Sequence[Path], run_folder: Path) -> AgentSpec:
    """Return the agent in a box that shows its file's folder without the hidden ones. Built-in agents need no box.

    run_folder: hidden with its neighbours, which are the folders of other runs, unless the agent is among them.
    Raises InputError for an agent that no box can show, or if this machine has no such boxes.
    """
    if spec.is_builtin:
        return spec
    file, prefix, ending = find_boxed_file(spec)
    folder = file.parent
    for path in hidden:
        if folder.is_relative_to(path):
            raise InputError(
                f"--sandbox: expected an agent in a folder of its own, found {file} inside {path}, which a box hides"
            )
    _check_machine()
    site = Path(sysconfig.get_path("purelib"))
    run_folder = run_folder.resolve()
    runs = run_folder if folder.is_relative_to(run_folder.parent) else run_folder.parent
    box = AgentBox(folder, sys.executable, site, limits=LOCAL_BOX_LIMITS, hidden=(*hidden, runs))
    return replace(
        spec,
        agent=f"{prefix}{AGENT_FOLDER}/{file.name}{ending}",
        config={key: _move_path(value, folder) for key, value in spec.config.items()},
        box=box,
        known_as=spec.name,
    )


@lru_cache(maxsize=1)
def _check_machine() -> None:
    """Raise InputError if this machine has no boxes with the required layers; opens a box on the first call."""
    check_layers(REQUIRED_LAYERS)


def find_boxed_file(spec: AgentSpec) -> tuple[Path, str, str]:
    """Return the file of an agent that can run in a box, and what stands before and behind it in the locator.

    Raises InputError for one that cannot, because it is a module.
    """
    if isinstance(spec.agent, str):
        if (file := find_carla_file(spec.agent)) is not None:
            return file.resolve(), f"{spec.agent.partition(':')[0]}:", ""
        place, name = split_locator(spec.agent)
        if place.endswith(".py"):
            return Path(place).resolve(), "", f":{name}"
    raise InputError(
        f"--sandbox: expected path.py:Class or carla:path.py, whose folder a box can show, found {spec.name!r:.80}"
    )


def _move_path(value: object, folder: Path) -> object:
    """Return an option's value; of a file in the agent's folder, its path as the box shows it."""
    if not isinstance(value, str) or not value or "\0" in value or len(value) > 1000:
        return value
    path = Path(value).resolve()
    inside = path.is_relative_to(folder) and path != folder and path.exists()
    return f"{AGENT_FOLDER}/{path.relative_to(folder)}" if inside else value
