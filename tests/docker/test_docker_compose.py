"""The Dockerfile and the compose file say nothing that is not so: read without an engine."""

import configparser
import re
import shlex
from pathlib import Path
from typing import Any

import click
import pytest
import yaml
from click.testing import CliRunner
from testing.paths import ROOT

from mdrive_sumo.agent_process.sandbox import BoxLimits
from mdrive_sumo.cli import main
from server.environments import IMAGE_PYTHON, RECIPES
from server.settings import ServerSettings, load_settings

DOCKER = ROOT / "docker"
SERVICES: dict[str, Any] = yaml.safe_load((DOCKER / "compose.yaml").read_text())["services"]
OURS = {name: each for name, each in SERVICES.items() if "build" in each}
VOLUMES: set[str] = set(yaml.safe_load((DOCKER / "compose.yaml").read_text())["volumes"])
INSTRUCTIONS = [
    shlex.split(line, comments=True)
    for line in (DOCKER / "Dockerfile").read_text().replace("\\\n", " ").splitlines()
    if line and not line.startswith("#")
]
BOX_OPTIONS = {"no-new-privileges:true", "seccomp=unconfined", "apparmor=unconfined", "systempaths=unconfined"}


def stages() -> dict[str, list[list[str]]]:
    """Instructions of each stage, by its name, those of the stage that it is made from first."""
    found: dict[str, list[list[str]]] = {}
    name = ""
    for words in INSTRUCTIONS:
        if words[0] == "FROM":
            name = words[3]
            found[name] = list(found.get(words[1], []))
        elif name:
            found[name].append(words)
    return found


STAGES = stages()


def of(stage: str, instruction: str) -> list[list[str]]:
    return [words[1:] for words in STAGES[stage] if words[0] == instruction]


def listed(found: list[list[str]]) -> list[str]:
    """The last one of instructions in the form of a list, without its quotes, which are gone."""
    return " ".join(found[-1]).strip("[]").split(", ")


def variables(name: str) -> dict[str, str]:
    return dict(line.split("=", 1) for line in (DOCKER / f"{name}.env.example").read_text().split())


def usage(command: click.Command, words: list[str]) -> str:
    """What a command line says of itself; options and commands that do not exist are an error."""
    result = CliRunner().invoke(command, [*words, "--help"])
    assert result.exit_code == 0, result.output
    return result.output.partition("\n")[0]


@pytest.mark.parametrize("stage", ["server", "evaluator", "agent"])
def test_images_have_a_user_of_their_own(stage: str) -> None:
    users = [user for (user,) in of(stage, "USER")]
    assert users[-1] in ("mdrive", "agent")
    assert any("--uid 10001" in " ".join(words) and users[-1] in words for words in of(stage, "RUN"))


def test_packages_come_with_checksums_and_from_no_named_index() -> None:
    text = (DOCKER / "Dockerfile").read_text()
    assert "http" not in text.replace("http://127.0.0.1", "")
    downloads, _, offline = text.partition("ENV PIP_NO_INDEX=1")
    wanted = "wheel --no-cache-dir --no-deps --require-hashes -r needed.lock -w wheels"
    assert re.findall(r"bin/pip (.*)", downloads) == [wanted]
    left_out = re.findall(r"requirements\.lock >(\S+)|\^\(([^)]*)\)==", downloads)
    assert [file for file, _ in left_out if file] == ["needed.lock"]
    locked = set(re.findall(r"^([\w.-]+)==", (ROOT / "requirements.lock").read_text(), re.MULTILINE))
    assert {name for _, names in left_out if names for name in names.split("|")} <= locked
    assert "PIP_" not in offline.partition("\n")[2]
    assert all("pip" not in words for stage in ("server", "evaluator", "agent") for words in of(stage, "RUN"))


def test_what_is_copied_exists_and_is_not_ignored() -> None:
    ignored = (DOCKER / "Dockerfile.dockerignore").read_text().split()
    taken = [words[:-1] for words in of("build", "COPY")]
    for name in (name for names in taken for name in names):
        assert (ROOT / name).exists() and f"!{name}" in ignored
    assert ignored[0] == "*"


@pytest.mark.slow
def test_the_server_is_asked_whether_it_is_well() -> None:
    ((*_, url),) = of("server", "HEALTHCHECK")
    port, path = re.search(r"127\.0\.0\.1:(\d+)(/\S+)'", url).groups()  # type: ignore[union-attr]
    assert (int(port), [[port]]) == (ServerSettings().port, of("server", "EXPOSE"))
    from server.api.app import create_app

    assert path in create_app(ServerSettings(data=Path("/nowhere"))).openapi()["paths"]


@pytest.mark.slow  # dask is imported
@pytest.mark.parametrize("name", OURS)
def test_services_run_what_there_is(name: str) -> None:
    from distributed.cli import dask_scheduler, dask_worker

    service = OURS[name]
    build = service["build"]
    assert (DOCKER / build["context"]).resolve() == ROOT and (ROOT / build["dockerfile"]).is_file()
    assert service["image"] == f"mdrive-{build['target']}" and build["target"] in STAGES
    target = build["target"]
    entry = service.get("entrypoint") or listed(of(target, "ENTRYPOINT"))
    words = [*entry, *(service.get("command") or ([] if "entrypoint" in service else listed(of(target, "CMD"))))]
    if words[0] == "dask":
        assert usage({"scheduler": dask_scheduler, "worker": dask_worker}[words[1]].main, words[2:])
    else:
        assert words[0] == "mdrive-sumo"
        assert {"environment": "import", "server": "serve"}[name] in usage(main, words[1:])


def test_services_wait_for_what_can_be_waited_for() -> None:
    for service in SERVICES.values():
        for other, how in service.get("depends_on", {}).items():
            asked = "healthcheck" in SERVICES[other]
            assert how["condition"] == ("service_healthy" if asked else "service_completed_successfully")


def test_volumes_and_files_exist() -> None:
    for service in SERVICES.values():
        for volume in service.get("volumes", []):
            source = volume.split(":")[0]
            assert source in VOLUMES or (DOCKER / source).is_file()
        if "env_file" in service:
            assert (DOCKER / f"{service['env_file']}.example").is_file()
    assert "*.env" in (DOCKER / ".gitignore").read_text()


def test_the_variables_are_settings_that_fit_the_services() -> None:
    service = SERVICES["server"]
    mounts = {target: source for source, target in (volume.split(":")[:2] for volume in service["volumes"])}
    told = {**variables("server"), **service["environment"]}
    file = DOCKER / mounts[told.pop("MDRIVE_SETTINGS")]
    settings = load_settings(file, told)
    dask = SERVICES["scheduler"]["entrypoint"]
    assert settings.work.scheduler == f"tcp://scheduler:{dask[dask.index('--port') + 1]}"
    assert settings.work.scheduler in SERVICES["evaluator"]["entrypoint"]
    database = variables("database")
    login = f"{database['POSTGRES_USER']}:{database['POSTGRES_PASSWORD']}"
    assert settings.database_url == f"postgresql://{login}@database/{database['POSTGRES_DB']}"
    assert settings.phases
    for name in ("environment", "evaluator", "server"):
        assert f"data:{settings.data}" in SERVICES[name]["volumes"]


def test_a_plain_user_in_a_container_has_the_layers_that_are_demanded() -> None:
    missing = {"uid", "cgroup", "private-files", "proc"}
    demanded = set(load_settings(DOCKER / "settings.toml", {}).sandbox.required)
    assert demanded == set(ServerSettings().sandbox.required) - missing


def test_only_what_opens_boxes_is_less_confined() -> None:
    assert {name for name, each in OURS.items() if set(each["security_opt"]) == BOX_OPTIONS} == {
        "environment",
        "evaluator",
    }
    for service in OURS.values():
        assert service["cap_drop"] == ["ALL"] and "no-new-privileges:true" in service["security_opt"]
    assert not any("privileged" in each or "cap_add" in each or "user" in each for each in SERVICES.values())
    page = (ROOT / "docs" / "docker.md").read_text()
    assert all(f"`{option}`" in page for option in BOX_OPTIONS if option.endswith("unconfined"))


def test_the_cluster_and_the_database_are_not_reachable_from_outside() -> None:
    outside = {name for name, each in SERVICES.items() if "outside" in each.get("networks", [])}
    assert outside == {name for name, each in SERVICES.items() if "ports" in each} == {"server"}
    assert all(port.startswith("127.0.0.1:") for port in SERVICES["server"]["ports"])
    assert yaml.safe_load((DOCKER / "compose.yaml").read_text())["networks"]["inside"]["internal"] is True


def test_the_agent_image_is_where_it_is_imported_from() -> None:
    *_, name, folder = SERVICES["environment"]["command"]
    assert name in RECIPES
    assert ["--from=agent", "/", folder] in of("evaluator", "COPY")
    assert f'"{IMAGE_PYTHON}"' in (DOCKER / "Dockerfile").read_text()


def test_a_container_has_room_for_its_boxes() -> None:
    """One job at a time; the suites have up to eight CAVs."""
    evaluator = SERVICES["evaluator"]
    words = evaluator["entrypoint"]
    assert words[words.index("--nthreads") + 1] == "1" and evaluator["init"] is True
    limits = load_settings(DOCKER / "settings.toml", {}).sandbox.box_limits()
    assert BoxLimits().processes < limits.processes < evaluator["pids_limit"]
    assert int(evaluator["mem_limit"].removesuffix("g")) * 2**30 > 8 * limits.memory_bytes


def test_containers_and_the_systemd_unit_have_the_documented_limits() -> None:
    """The unit has those of a server and two evaluators together."""
    page = (ROOT / "docs" / "docker.md").read_text()
    for name in ("database", "scheduler", "server", "evaluator"):
        assert f"| `{name}` | {SERVICES[name]['mem_limit'][:-1]} GiB | {SERVICES[name]['pids_limit']} |" in page
    unit = configparser.ConfigParser(strict=False, interpolation=None)
    unit.optionxform = str  # type: ignore[assignment, method-assign]
    unit.read(DOCKER / "mdrive-server.service")
    service = unit["Service"]
    workers = int(re.search(r"PROCESSES=(\d+)", service["Environment"])[1])  # type: ignore[index]
    each = [(int(one["mem_limit"][:-1]), one["pids_limit"]) for one in (SERVICES["server"], SERVICES["evaluator"])]
    memory, tasks = (each[0][n] + workers * each[1][n] for n in (0, 1))
    assert (service["MemoryMax"], service["TasksMax"]) == (f"{memory}G", str(tasks))
    assert f"| `mdrive-server.service`, {workers} workers | {memory} GiB | {tasks} |" in page
    assert service["UMask"] == "0077" and service["StateDirectoryMode"] == "0700" and service["Delegate"] == "yes"
    program, *words = shlex.split(service["ExecStart"])
    assert program.endswith("/bin/mdrive-sumo") and usage(main, words)
