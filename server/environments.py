"""The environments that agents run in: named, and built before any participant's code runs."""

import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from mdrive_sumo.agent_process.sandbox import BoxError, BoxLimits, BoxSpec, open_box
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_text
from mdrive_sumo.core.output_files import make_folder, write_text
from mdrive_sumo.core.suggestion import describe_unknown

ABOUT_FILE = "environment.json"
BUILD_S = 1800.0
"""Time limit of one command of a build [s]; PyTorch took 103 s from a folder (docs/server-environments.md)."""
IMAGE_PYTHON = "/opt/agent/bin/python"
"""Interpreter in the agent image of `docker/Dockerfile`."""
PROGRAMS = ("opt", "usr")
"""Folders of an image that contain programs."""
PROBE = """
import importlib.metadata as metadata, sys
print("%d.%d" % sys.version_info[:2])
for name, version in sorted({(found.name.lower(), found.version) for found in metadata.distributions()}):
    print(name + "==" + version)
"""
"""Program that lists an image's Python version and packages."""
PROBE_S = 60.0
"""Time limit of the start of an image's interpreter [s]."""


@dataclass(frozen=True, slots=True)
class EnvironmentRecipe:
    """Contents of a named environment."""

    name: str
    python: str
    """Version of the interpreter: major.minor."""
    packages: tuple[str, ...]
    """Exact, because an agent's results depend on them. The connection to the evaluator needs `msgpack`."""
    memory_bytes: int
    """Least memory of a sandbox with this environment."""
    has_lock: bool = False
    """Whether `recipes/NAME.lock` has all its packages, also those that they need, with checksums."""


MEBIBYTE = 1024 * 1024
LOCKS = Path(__file__).parent / "recipes"
BASE = ("msgpack==1.2.4", "numpy==2.4.6", "pyyaml==6.0.3")
"""PyYAML, because agents of the CARLA leaderboard read their options with it."""
RECIPES: Mapping[str, EnvironmentRecipe] = {
    find_recipe.name: find_recipe
    for find_recipe in (
        EnvironmentRecipe("python3.11-numpy", "3.11", BASE, 512 * MEBIBYTE, has_lock=True),
        EnvironmentRecipe("python3.11-onnx", "3.11", (*BASE, "onnxruntime==1.26.0"), 1024 * MEBIBYTE, has_lock=True),
        EnvironmentRecipe("python3.11-torch-cpu", "3.11", (*BASE, "torch==2.13.0+cpu"), 2048 * MEBIBYTE),
    )
}


@dataclass(frozen=True, slots=True)
class Environment:
    """A built environment, for an `AgentBox`."""

    name: str
    python: Path
    """Interpreter; a path inside `rootfs` if there is one."""
    site: Path | None
    """Folder with the packages; None if the interpreter finds them itself."""
    packages: tuple[str, ...]
    """All packages, name==version: results are reproducible only with the same ones."""
    rootfs: Path | None = None
    """Unpacked image that sandboxes see instead of the host's programs."""
    image: str = ""
    """Checksum of the names and sizes of the image's programs when it was imported."""


def find_recipe(name: str) -> EnvironmentRecipe:
    """Return the recipe of that name. Raises InputError, which lists the known names."""
    if name not in RECIPES:
        raise InputError(f"environment: {describe_unknown(name, RECIPES)}")
    return RECIPES[name]


def load_environment(name: str, folder: Path) -> Environment:
    """Load a built environment from a folder of environments. Raises InputError if it is unknown or not built."""
    find_recipe(name)
    about = folder / name / ABOUT_FILE
    try:
        content = json.loads(read_text(about))
        site, rootfs = (Path(content[key]) if content.get(key) else None for key in ("site", "rootfs"))
        return Environment(
            name,
            Path(content["python"]),
            site,
            tuple(content["packages"]),
            rootfs,
            content.get("image", ""),
        )
    except FileNotFoundError:
        raise InputError(
            f"environment {name}: not built in {folder}; run mdrive-sumo admin environment build {name}"
        ) from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{about}: expected a description of an environment, found none ({error})") from None


def compute_digest(name: str, folder: Path) -> str | None:
    """Return a digest of an environment's contents; None if it is not built, which a later use reports."""
    try:
        built = load_environment(name, folder)
    except InputError:
        return None
    return hashlib.sha256(json.dumps([built.packages, built.image]).encode()).hexdigest()[:16]


def list_built(folder: Path) -> list[str]:
    """Return the names of the environments built in a folder."""
    return [name for name in RECIPES if (folder / name / ABOUT_FILE).is_file()]


def current_environment() -> Environment:
    """Return this interpreter with its packages, for dry runs where nothing is built; it may have further packages."""
    import msgpack  # every environment has both; their folder may be any on the path
    import numpy

    site = Path(numpy.__file__).parents[1]
    if Path(str(msgpack.__file__)).parents[1] != site:
        raise InputError(f"environment: expected numpy and msgpack in one folder, found numpy alone in {site}")
    return Environment("this Python", Path(sys.executable), site, ())


def build_environment(
    name: str, folder: Path, pip_options: Sequence[str] = (), wheels: Path | None = None
) -> Environment:
    """Build an environment with venv and the interpreter's pip, from wheels only; pip's settings name the index.

    wheels: a folder of wheels, from which alone everything comes, without a network; None: from the index. An existing
    environment is not overwritten, since sandboxes may use it. Raises InputError.
    """
    recipe = find_recipe(name)
    target = folder / name
    if (target / ABOUT_FILE).exists():
        raise InputError(f"environment {name}: already built in {folder}; remove {target} to build it again")
    interpreter = f"python{recipe.python}"
    _run((interpreter, "-m", "venv", "--clear", "--without-pip", str(target)), name)
    python = target / "bin" / "python"
    pip = (interpreter, "-m", "pip", "--python", str(python), "--disable-pip-version-check", "--no-input")
    offline = () if wheels is None else ("--no-index", "--find-links", str(wheels))
    packages = ("--require-hashes", "-r", str(LOCKS / f"{name}.lock")) if recipe.has_lock else recipe.packages
    _run((*pip, "install", "--no-cache-dir", "--only-binary=:all:", *offline, *pip_options, *packages), name)
    packages = tuple(_run((*pip, "freeze", "--all"), name).split())
    site = target / "lib" / interpreter / "site-packages"
    return _write_description(Environment(name, python.absolute(), site.absolute(), packages), target)


def import_image(
    name: str, folder: Path, rootfs: Path, python: str = IMAGE_PYTHON, limits: BoxLimits | None = None
) -> Environment:
    """Register an unpacked image as the environment. It is not copied: it must be at this path on every worker.

    Its packages are listed in a sandbox, because the image is untrusted. A newer image may replace an imported one,
    but not one that was built here. Needs the main thread. Raises InputError.
    """
    recipe = find_recipe(name)
    target = folder / name
    if (target / ABOUT_FILE).exists() and load_environment(name, folder).rootfs is None:
        raise InputError(f"environment {name}: built in {folder}; remove {target} to import an image in its place")
    limits = limits or BoxLimits()
    limits = replace(limits, memory_bytes=max(limits.memory_bytes, recipe.memory_bytes))
    version, *packages = _list_packages(
        name, BoxSpec((python, "-c", PROBE), {}, limits=limits, rootfs=rootfs.resolve())
    )
    if version != recipe.python:
        raise InputError(f"environment {name}: expected Python {recipe.python} in {rootfs}, found {version:.20}")
    if missing := [package for package in recipe.packages if package not in packages]:
        raise InputError(
            f"environment {name}: expected {', '.join(missing)} in {rootfs}, found {' '.join(packages):.300}"
        )
    make_folder(target)
    made = Environment(name, Path(python), None, tuple(packages), rootfs.resolve(), _checksum_programs(rootfs))
    return _write_description(made, target)


def _checksum_programs(rootfs: Path) -> str:
    """Return a checksum of names and sizes: reading all contents would take minutes."""
    digest = hashlib.sha256()
    for folder, folders, files in (step for part in PROGRAMS for step in os.walk(rootfs / part)):
        folders.sort()
        for file in sorted(files):
            path = Path(folder, file)
            digest.update(os.fsencode(f"{path.relative_to(rootfs)}\0{path.lstat().st_size}\0"))
    return digest.hexdigest()


def _list_packages(name: str, spec: BoxSpec) -> list[str]:
    """Return major.minor of an image's interpreter, then its packages."""
    try:
        with open_box(spec) as box:
            box.ready(PROBE_S)
            report = box.close()
        words, failed = box.log().decode(errors="replace").split(), report.exit_code != 0
    except BoxError as error:  # also if the image has no such program
        words, failed = str(error).split(), True
    if failed or not words:
        output = " ".join(words)[-300:] or "no output"
        raise InputError(f"environment {name}: {spec.command[0]} of {spec.rootfs} does not list its packages: {output}")
    return words


def _write_description(made: Environment, target: Path) -> Environment:
    about = target / ABOUT_FILE
    write_text(about, json.dumps(asdict(made), default=str, indent=1))
    return made


def _run(command: tuple[str, ...], name: str) -> str:
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=BUILD_S)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise InputError(f"environment {name}: {command[0]} cannot be run: {error}") from None
    if done.returncode:
        output = (done.stderr.strip() or done.stdout.strip() or "no output").splitlines()
        raise InputError(f"environment {name}: {' '.join(command[1:4])} failed: {output[-1]:.300}")
    return done.stdout
