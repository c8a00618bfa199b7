"""Settings: a file, variables over it, and one sentence where something is wrong."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel
from testing.paths import ROOT

from mdrive_sumo.agent_process.sandbox.limits import BoxLimits
from mdrive_sumo.core.errors import InputError
from server.settings import ServerSettings, load_settings
from server.store import Store, phases
from server.store.retention import RetentionPolicy

FILE = """
data = "/srv/mdrive"
port = 9000

[limits]
archive_bytes = 1000

[work]
lease_s = 120
heartbeat_s = 20

[[phases]]
id = "warm-up"
title = "Warm-up"
suite = "interdrive"
public = true
opens = 2026-01-01T00:00:00Z
closes = 2026-02-01T01:00:00+01:00
per_day = 5
"""


def written(folder: Path, content: str) -> Path:
    (file := folder / "server.toml").write_text(content, "utf-8")
    return file


def test_the_example_of_the_docs_names_every_setting_with_its_default(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "server.md").read_text("utf-8")
    example = page.partition("```toml\n")[2].partition("```")[0]
    settings = load_settings(written(tmp_path, example), {})
    without_examples = settings.model_copy(update={"data": ServerSettings().data, "phases": ()})
    assert without_examples == ServerSettings()
    assert [name for name in list_fields(settings) if not re.search(rf"\b{name}\b", example)] == []


def list_fields(model: BaseModel) -> Iterator[str]:
    """Names of the fields of a model, and of the models in it."""
    for name, value in model:
        yield name
        for inner in value if isinstance(value, tuple) else (value,):
            if isinstance(inner, BaseModel):
                yield from list_fields(inner)


def test_defaults_are_a_laptop() -> None:
    settings = load_settings(None, {})
    assert settings == ServerSettings()
    assert settings.database_url == f"sqlite:///{Path('mdrive-data').absolute()}/challenge.sqlite"
    assert settings.sandbox.box_limits() == BoxLimits()
    assert settings.keep.policy() == RetentionPolicy()


def test_a_file_and_variables_over_it(tmp_path: Path) -> None:
    environ = {
        "MDRIVE_DATABASE": "postgresql://u@h/n",
        "MDRIVE_LIMITS__ARCHIVE_BYTES": "2000",
        "MDRIVE_SANDBOX__MEMORY_BYTES": "4000",
        "MDRIVE_SANDBOX__REQUIRED": "namespaces,seccomp",
        "MDRIVE_PORT": "9001",
        "MDRIVE_TOKEN": "of a client",
        "HOME": "/root",
    }
    settings = load_settings(written(tmp_path, FILE), environ)
    assert (settings.data, settings.port, settings.database_url) == (Path("/srv/mdrive"), 9001, "postgresql://u@h/n")
    assert (settings.limits.archive_bytes, settings.limits.entries) == (2000, 2000)
    assert settings.sandbox.box_limits().memory_bytes == 4000
    assert settings.sandbox.required == ("namespaces", "seccomp")
    assert (settings.archives, settings.recordings) == (Path("/srv/mdrive/archives"), Path("/srv/mdrive/recordings"))


def test_phases_reach_the_store_with_utc_times(tmp_path: Path) -> None:
    (new,) = (phase.as_new() for phase in load_settings(written(tmp_path, FILE), {}).phases)
    store = Store(f"sqlite:///{tmp_path / 'x.sqlite'}")
    store.migrate()
    with store.write() as session:
        phases.set_phases(session, [new], 0)
        phase = phases.get(session, "warm-up")
    store.close()
    assert (phase.opens_us, phase.closes_us) == (1_767_225_600_000_000, 1_769_904_000_000_000)
    assert (phase.per_day, phase.in_parallel, phase.public, phase.suite) == (5, 1, True, "interdrive")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("port = 'x'", "port: .*found 'x'"),
        ("colour = 1", "colour: "),
        ("limits = 3", "limits: "),
        ("[limits]\narchive_bytes = 0", r"limits.archive_bytes: .*found 0"),
        ("[work]\nlease_s = 30", r"work.lease_s: .*40.*found 30"),
        ("[work]\nheartbeat_s = 30", "heartbeat_s: expected at most a third of lease_s 60, found 30"),
        ("port = ", "expected TOML"),
        (FILE + FILE[FILE.index("[[phases]]") :], "expected every id once, found warm-up, warm-up"),
        (FILE.replace("2026-02", "2025-02"), "closes: expected a time after opens"),
        (FILE.replace("00Z", "00"), r"phases.0.opens: .*timezone"),
        (FILE.replace('"warm-up"', '"Warm up"'), r"phases.0.id: "),
        (FILE.replace('suite = "interdrive"\n', ""), r"phases.0.suite: Field required"),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(tmp_path: Path, content: str, said: str) -> None:
    with pytest.raises(InputError, match=f"server.toml: .*{said}") as refused:
        load_settings(written(tmp_path, content), {})
    assert "\n" not in str(refused.value)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        load_settings(tmp_path / "none.toml", {})


@pytest.mark.parametrize(
    "name", ["MDRIVE_DATABSE", "MDRIVE_LIMITS", "MDRIVE_PHASES", "MDRIVE_WORK__X", "MDRIVE_A__B__C", "MDRIVE_"]
)
def test_variables_that_set_nothing_are_named(name: str) -> None:
    with pytest.raises(InputError, match=f"{name} is not a setting"):
        load_settings(None, {name: "1"})


def test_a_variable_into_what_is_no_table(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="settings: limits: expected a table, found 3"):
        load_settings(written(tmp_path, "limits = 3"), {"MDRIVE_LIMITS__ENTRIES": "1"})


@given(st.text(max_size=30))
def test_no_text_of_a_variable_breaks_it(text: str) -> None:
    try:
        assert 0 <= load_settings(None, {"MDRIVE_PORT": text}).port <= 65535
    except InputError as refused:
        assert "port" in str(refused)
