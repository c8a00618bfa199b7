"""The environments of agents: how they are built, from which files, and how they are found again."""

import hashlib
import sys
import zipfile
from contextlib import nullcontext
from pathlib import Path

import pytest
from testing.paths import ROOT

from mdrive_sumo.core.errors import InputError
from server import environments
from server.environments import EnvironmentRecipe, build_environment, load_environment


def test_unknown_environments_are_told_the_known() -> None:
    with pytest.raises(InputError, match=r"one of python3.11-numpy, python3.11-onnx, python3.11-torch-cpu, found 'x'"):
        load_environment("x", Path())


def wheel(folder: Path, name: str) -> None:
    """A package with one module that is empty."""
    about = f"{name}-1.0.dist-info"
    with zipfile.ZipFile(folder / f"{name}-1.0-py3-none-any.whl", "w") as made:
        made.writestr(f"{name}.py", "")
        made.writestr(f"{about}/METADATA", f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        made.writestr(f"{about}/WHEEL", "Wheel-Version: 1.0\nGenerator: us\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        made.writestr(f"{about}/RECORD", "")


def test_what_a_build_runs_and_keeps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recipe = EnvironmentRecipe("mine", "3.11", ("tiny==1.0",), 1)
    monkeypatch.setattr(environments, "RECIPES", {"mine": recipe})
    commands: list[tuple[str, ...]] = []

    def run(command: tuple[str, ...], _: str) -> str:
        commands.append(command)
        Path(tmp_path / "mine").mkdir(exist_ok=True)
        return "pip==1\ntiny==1.0\n" if "freeze" in command else ""

    monkeypatch.setattr(environments, "_run", run)
    built = build_environment("mine", tmp_path, ("--no-index",))
    assert load_environment("mine", tmp_path) == built
    assert (built.python, built.packages) == (tmp_path / "mine" / "bin" / "python", ("pip==1", "tiny==1.0"))
    venv, install, freeze = commands
    assert venv == ("python3.11", "-m", "venv", "--clear", "--without-pip", str(tmp_path / "mine"))
    assert install[:5] == ("python3.11", "-m", "pip", "--python", str(built.python)) == freeze[:5]
    assert install[-2:] == ("--no-index", "tiny==1.0")
    with pytest.raises(InputError, match="already built"):
        build_environment("mine", tmp_path)
    assert len(commands) == 3


def test_a_build_that_fails_says_what_failed() -> None:
    with pytest.raises(InputError, match=r"environment none: -c .* failed: no such package: absent"):
        environments._run((sys.executable, "-c", "raise SystemExit('no such package: absent')"), "none")


@pytest.mark.full  # in `make test`: the commands that it runs, above
def test_an_environment_is_built_once_and_found_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wheel(tmp_path, "tiny")
    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    recipes = {
        "mine": EnvironmentRecipe("mine", python, ("tiny==1.0",), 1),
        "none": EnvironmentRecipe("none", python, ("absent==1.0",), 1),
    }
    monkeypatch.setattr(environments, "RECIPES", recipes)
    offline = ("--no-index", "--find-links", str(tmp_path))
    built = build_environment("mine", tmp_path / "envs", offline)
    assert load_environment("mine", tmp_path / "envs") == built
    assert built.site is not None and (built.site / "tiny.py").is_file()
    assert "tiny==1.0" in built.packages
    with pytest.raises(InputError, match="already built"):
        build_environment("mine", tmp_path / "envs", offline)
    with pytest.raises(InputError, match=r"-m pip .* failed: .*absent"):
        build_environment("none", tmp_path / "envs", offline)
    with pytest.raises(InputError, match="not built in"):
        load_environment("none", tmp_path / "envs")


def read_lock(text: str) -> dict[str, set[str]]:
    """Checksums by name==version of a lock file."""
    found: dict[str, set[str]] = {}
    name = ""
    for line in text.splitlines():
        if line and not line.startswith((" ", "#")):
            name = line.split()[0]
            found[name] = set()
        elif "--hash=" in line:
            found[name].add(line.split("--hash=")[1].split()[0])
    return found


@pytest.mark.parametrize("recipe", [one for one in environments.RECIPES.values() if one.has_lock])
def test_a_locked_recipe_has_the_checksums_of_the_projects_lock(recipe: EnvironmentRecipe) -> None:
    locked = read_lock((environments.LOCKS / f"{recipe.name}.lock").read_text())
    project = read_lock((ROOT / "requirements.lock").read_text())
    assert set(recipe.packages) <= locked.keys()
    assert locked.items() <= project.items()


def test_a_locked_recipe_is_built_from_a_folder_of_wheels_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    commands: list[tuple[str, ...]] = []
    monkeypatch.setattr(environments, "_run", lambda command, _: commands.append(command) or "")
    (tmp_path / "python3.11-onnx").mkdir()
    build_environment("python3.11-onnx", tmp_path, wheels=tmp_path / "wheels")
    lock = environments.LOCKS / "python3.11-onnx.lock"
    offline = ("--no-index", "--find-links", str(tmp_path / "wheels"))
    assert commands[1][-6:] == (*offline, "--require-hashes", "-r", str(lock))


@pytest.mark.full  # in `make test`: the command that it runs, above
def test_a_wheel_with_another_checksum_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The index of pip's settings is not asked, whatever the folder lacks."""
    monkeypatch.setenv("PIP_INDEX_URL", "http://127.0.0.1:9/simple")
    wheel(tmp_path, "tiny")
    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    recipe = EnvironmentRecipe("mine", python, ("tiny==1.0",), 1, has_lock=True)
    monkeypatch.setattr(environments, "RECIPES", {"mine": recipe})
    monkeypatch.setattr(environments, "LOCKS", tmp_path)
    checksum = hashlib.sha256((tmp_path / "tiny-1.0-py3-none-any.whl").read_bytes()).hexdigest()
    for text, fails in (("0" * 64, "mine: -m pip .* failed: "), (checksum, "")):
        (tmp_path / "mine.lock").write_text(f"tiny==1.0 \\\n    --hash=sha256:{text}\n")
        with pytest.raises(InputError, match=fails) if fails else nullcontext():
            assert "tiny==1.0" in build_environment("mine", tmp_path / "envs", wheels=tmp_path).packages
