"""The images, built without an engine and run: minutes, gigabytes of disk, Debian's mirror, an index of packages."""

import os
import shlex
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import httpx
import pytest
from testing.paths import ROOT

from server.environments import import_image

SOURCES = (
    "docker",
    "mdrive_sumo",
    "networks",
    "real2sim",
    "server",
    "LICENSE",
    "README.md",
    "hatch_build.py",
    "pyproject.toml",
    "requirements.lock",
)
PATIENCE_S = 1500
"""For one command: an image took 220 s on two cores that were shared with little else, and more than 900 s on a busy
machine."""
MEMORY_KB = 10e6
"""The store is kept in memory where so much is free: it grows to 3.5 GB, and on a disk that is told of freed blocks at
once its removal takes four minutes."""
pytestmark = [
    pytest.mark.full,
    pytest.mark.timeout(4 * PATIENCE_S),
    pytest.mark.skipif(os.geteuid() != 0, reason="needs root"),
    pytest.mark.skipif(not (shutil.which("buildah") and shutil.which("mmdebstrap")), reason="needs buildah"),
]

ENVIRONMENT = ("env", "-i", "PATH=/opt/mdrive-sumo/bin:/usr/bin:/bin", "HOME=/home/mdrive", "MDRIVE_DATA=/data")
BASE = """
mount -t tmpfs base "$1"
mmdebstrap --quiet --variant=minbase --include=python3,python3-venv bookworm "$1/root"
empty=$($2 from scratch)
$2 add --quiet "$empty" "$1/root" /
$2 commit --quiet --rm "$empty" localhost/base
"""
"""An image of Debian's own packages, made in memory: on a disk it takes twice as long."""
CONTAINER = """
root=$1 masked=$2; shift 2
mount --bind "$root" "$root"; cd "$root"; mkdir -p .old; pivot_root . .old
mount -t proc proc /proc; mount -t tmpfs tmp /tmp; mount --rbind /.old/dev /dev; mount -t sysfs -o ro sysfs /sys
umount -l /.old
if [ "$masked" = masked ]; then mount --bind /proc/sys /proc/sys; mount -o remount,ro,bind /proc/sys; fi
cd /tmp
exec setpriv --reuid 10001 --regid 10001 --clear-groups --bounding-set=-all --inh-caps=-all --no-new-privs "$@"
"""
"""A container as an engine makes it, as far as the kernel sees it: its own root and namespaces, a plain user without
capabilities who can win none, `/proc/sys` for reading only or not. Not the engine's filter of system calls, nor
AppArmor."""


@dataclass(frozen=True, slots=True)
class Images:
    """Built with buildah in a store of their own, from a copy of the code, which does not change meanwhile."""

    store: Path
    context: Path

    def command(self, *words: str) -> tuple[str, ...]:
        return ("buildah", "--root", str(self.store / "root"), "--runroot", str(self.store / "run"), *words)

    def buildah(self, *words: str) -> str:
        return done(self.command(*words))

    def build(self, target: str) -> None:
        options = ("--format", "docker", "--isolation", "chroot", "--network", "host", "--layers", "--pull-never", "-q")
        build = ("--build-arg", "BASE=localhost/base", *index(), "--target", target, "--tag", f"localhost/{target}")
        self.buildah("bud", *options, *build, "--file", str(self.context / "docker" / "Dockerfile"), str(self.context))

    def container(self, image: str) -> str:
        return self.buildah("from", "--pull-never", f"localhost/{image}").strip()

    def run(self, container: str, *words: str) -> str:
        return self.buildah("run", "--isolation", "chroot", container, "--", *words)


def done(words: tuple[str, ...]) -> str:
    """What a command says; if it fails the test shows all of it."""
    found = subprocess.run(words, capture_output=True, text=True, check=False, timeout=PATIENCE_S)
    assert found.returncode == 0, f"{words}\n{found.stdout[-4000:]}\n{found.stderr[-4000:]}"
    return found.stdout


def index() -> list[str]:
    """This machine's settings of pip, as build arguments and mounts; they get into no file."""
    found: list[str] = []
    for name in ("index-url", "extra-index-url", "cert", "default-timeout"):
        command = (sys.executable, "-m", "pip", "config", "get", f"global.{name}")
        said = subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()
        value = os.environ.get(f"PIP_{name.upper().replace('-', '_')}", said)
        value = " ".join(word for word in value.split() if not word.startswith("file:"))
        if value:
            found += ["--build-arg", f"PIP_{name.upper().replace('-', '_')}={value}"]
        if value and name == "cert":
            found += ["--volume", f"{Path(value).parent}:{Path(value).parent}:ro"]
    return found


def has_memory() -> bool:
    """Whether the store has room in memory."""
    (free,) = (line for line in Path("/proc/meminfo").read_text().splitlines() if line.startswith("MemAvailable:"))
    return int(free.split()[1]) > MEMORY_KB


@contextmanager
def built(folder: Path) -> Generator[Images]:
    """The images on a base of Debian's own packages; nothing of them is left afterwards."""
    images = Images(folder / "store", folder / "context")
    base = folder / "base"
    base.mkdir()
    images.store.mkdir()
    in_memory = has_memory()
    if in_memory:
        done(("mount", "-t", "tmpfs", "store", str(images.store)))
    try:
        for name in SOURCES:
            copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
            images.context.mkdir(exist_ok=True)
            copy(ROOT / name, images.context / name)
        done(("unshare", "--mount", "sh", "-ec", BASE, "sh", str(base), shlex.join(images.command())))
        images.build("evaluator")
        images.build("server")
        yield images
    finally:
        images.buildah("rm", "--all")  # which ends their mounts
        if in_memory:
            done(("umount", "--lazy", str(images.store)))
        shutil.rmtree(images.store)


def inside(root: Path, *words: str, masked: bool = False) -> subprocess.CompletedProcess[str]:
    """Runs a command of an image where user namespaces work: buildah's chroot has none."""
    namespaces = ("unshare", "--mount", "--pid", "--fork", "--ipc", "--uts", "--net", "--propagation", "private")
    command = (*namespaces, "sh", "-ec", CONTAINER, "sh", str(root), "masked" if masked else "whole")
    return subprocess.run(
        (*command, *ENVIRONMENT, *words), capture_output=True, text=True, check=False, timeout=PATIENCE_S
    )


def evaluates(images: Images) -> None:
    """Baselines without boxes; agents of others in boxes that show them the agent image."""
    container = images.container("evaluator")
    assert images.run(container, "mdrive-sumo", "--version").startswith("mdrive-sumo, version")
    assert images.run(container, "id", "-un").strip() == "mdrive"
    one = ("--suite", "interdrive@0", "--scenario", "i07*", "--workers", "1")
    assert "outcomes     arrived" in images.run(
        container, "mdrive-sumo", "eval", *one, "--agent", "idm", "--out", "/work/r"
    )
    root = Path(images.buildah("mount", container).strip())
    for line in (
        "admin environment import python3.11-numpy /opt/environments/python3.11-numpy",
        "init-agent /work/mine",
        f"submit /work/mine --dry-run --environments /data/environments {' '.join(one)} --out /work/dry",
    ):
        found = inside(root, "mdrive-sumo", *line.split())
        assert found.returncode == 0, found.stdout + found.stderr
    note = root / "data" / "environments" / "python3.11-numpy" / "environment.json"
    assert "/opt/environments/python3.11-numpy" in note.read_text()


def has_the_layers_of_the_page(images: Images) -> None:
    """`docs/docker.md`, What boxes need inside a container."""
    root = Path(images.buildah("mount", images.container("evaluator")).strip())
    found = inside(root, "mdrive-sumo", "doctor", "--sandbox").stdout
    in_force = {line.split()[0] for line in found.splitlines() if "in force" in line}
    assert {"namespaces", "read-only", "privileges", "seccomp", "rlimits"} <= in_force
    assert not {"uid", "cgroup"} & in_force
    assert "max_user_namespaces" in inside(root, "mdrive-sumo", "doctor", "--sandbox", masked=True).stdout


def serves(images: Images) -> None:
    """As its image starts it, but for the port and the workers, who are elsewhere."""
    container = images.container("server")
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    told = ("--env", f"MDRIVE_PORT={port}", "--env", "MDRIVE_WORK__PROCESSES=0")
    command = images.command("run", "--isolation", "chroot", *told, container, "--", "mdrive-sumo", "serve")
    server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        answer = health(port, server)
    finally:
        server.terminate()
        said = server.communicate(timeout=60)[0]
    assert answer == {"status": "ok", "version": answer.get("version")}, said


def health(port: int, server: subprocess.Popen[str]) -> dict[str, str]:
    end = time.monotonic() + 300
    while time.monotonic() < end and server.poll() is None:
        try:
            return httpx.get(f"http://127.0.0.1:{port}/api/v1/health", trust_env=False).json()
        except httpx.TransportError:
            time.sleep(0.2)
    return {}


def keeps_to_what_is_written(images: Images) -> None:
    """Users and health check are in the images; compilers, pip and the settings of pip are not."""
    told = {name: images.buildah("inspect", "--type", "image", f"localhost/{name}") for name in ("server", "evaluator")}
    assert "/api/v1/health" in told["server"]
    for name, text in told.items():
        assert '"User": "mdrive"' in text and "PIP_" not in text.partition('"Docker"')[2].partition('"History"')[0]
        root = Path(images.buildah("mount", images.container(name)).strip())
        assert not list(root.glob("opt/*/lib/python3*/site-packages/pip"))
        assert not list(root.glob("usr/bin/*gcc*")) and not list(root.glob("build/*"))


def takes_a_participants_image(images: Images, folder: Path) -> None:
    """`docs/docker.md`, A participant's Dockerfile: built by the script, unpacked, imported."""
    images.build("agent")
    submission, tools, rootfs = folder / "submission", folder / "tools", folder / "images" / "red"
    for made in (submission, tools, rootfs):
        made.mkdir(parents=True)
    (submission / "Dockerfile").write_text(
        "FROM localhost/agent\nUSER root\nRUN mkdir /opt/agent/dev && touch /opt/agent/dev/of-team-red\n"
    )
    program = shlex.join((str(shutil.which("buildah")), *images.command()[1:]))
    (tools / "buildah").write_text(f'#!/bin/sh\nexec {program} "$@"\n')
    (tools / "buildah").chmod(0o755)
    path = f"PATH={tools}:/usr/sbin:/usr/bin:/sbin:/bin"
    script = (str(images.context / "docker" / "build-agent.sh"), str(submission), str(folder / "red.tar"))
    done(("env", path, *script, "--isolation", "chroot", "--network", "host", "--pull-never"))
    unpack = ("tar", "-x", "--no-same-owner", "--no-same-permissions", "--anchored", "--exclude=dev/*")
    done((*unpack, "--exclude=./dev/*", "-C", str(rootfs), "-f", str(folder / "red.tar")))
    made = import_image("python3.11-numpy", folder / "environments", rootfs)
    assert made.rootfs == rootfs and (rootfs / "opt" / "agent" / "dev" / "of-team-red").is_file()


def test_docker_images_do_what_the_page_says(tmp_path: Path) -> None:
    """One test: the images are made once."""
    with built(tmp_path) as images:
        keeps_to_what_is_written(images)
        evaluates(images)
        has_the_layers_of_the_page(images)
        serves(images)
        takes_a_participants_image(images, tmp_path)
