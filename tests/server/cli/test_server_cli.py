"""`mdrive-sumo admin`, and a real `mdrive-sumo serve`."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

import httpx
import pytest
import uvicorn
from click.testing import CliRunner, Result
from fastapi import FastAPI
from sqlalchemy import update
from testing import archive_samples
from testing.api_app import with_environment

from mdrive_sumo.cli.command_line import PLUG_IN_GROUP, main
from mdrive_sumo.cli.plug_in_commands import find_plug_ins
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.scenario.suite import load_suite
from server import COMMANDS, environments
from server.cli import admin, serve, serve_command
from server.cli.limited_protocol import LimitedListener
from server.enums import TokenScope
from server.environments import Environment
from server.settings import ServerSettings
from server.store import Store, tokens
from server.store.tables import AuditEntryRow

pytestmark = pytest.mark.slow

SETTINGS = """
port = 0
[work]
processes = 0
[[phases]]
id = "warm-up"
title = "Warm-up"
suite = "interdrive"
public = true
opens = 2000-01-01T00:00:00Z
closes = 2099-02-01T00:00:00Z
"""


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "server.toml").write_text(SETTINGS)
    monkeypatch.setenv("MDRIVE_SETTINGS", str(tmp_path / "server.toml"))
    monkeypatch.setenv("MDRIVE_DATA", str(tmp_path / "data"))
    return tmp_path / "data"


def run(*words: str) -> Result:
    return CliRunner().invoke(admin, words, catch_exceptions=True)


def said(*words: str) -> str:
    result = run(*words)
    assert result.exit_code == 0, result.output or result.exception
    return result.output.strip()


def test_teams_and_tokens(data: Path) -> None:
    text = said("team", "create", "red")
    assert text.startswith(tokens.PREFIX)
    assert "  red  20" in said("team", "list") and "hidden" not in said("team", "list")
    said("team", "hide", "red")
    assert said("team", "list").endswith("hidden")
    said("team", "hide", "red", "--show")
    boss = said("token", "issue", "--scope", "admin")
    with Store(f"sqlite:///{data / 'challenge.sqlite'}").read() as session:
        holder = tokens.find_token(session, boss)
        assert holder is not None and holder.scope == TokenScope.ADMIN
    line = said("token", "list", "--team", "red")
    assert text not in line and "submit" in line
    said("token", "revoke", line.split()[0])
    assert "revoked" in said("token", "list", "--team", "red")
    result = run("token", "issue")
    assert isinstance(result.exception, InputError) and "a team" in str(result.exception)


def test_phases_come_from_the_settings(data: Path) -> None:
    assert "expected one at" in str(run("phase", "list").exception) and not data.exists()
    said("phase", "apply")
    assert said("phase", "list").startswith("warm-up  public  2000-01-01 00:00:00 UTC - 2099-02-01")


def test_backup_audit_and_restore(data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said("team", "create", "red")
    head = said("backup", str(tmp_path / "b.sqlite"))
    assert said("audit") == f"2 entries, head {head}"
    listed = said("audit", "--list").splitlines()
    assert len(listed) == 3 and "  admin  team-created  {" in listed[0] and '"name": "red"' in listed[0]
    assert said("audit", "--list", "1").splitlines() == listed[1:]
    monkeypatch.setenv("MDRIVE_DATA", str(tmp_path / "other"))
    said("phase", "apply")  # as `serve` does at its start
    assert said("restore", str(tmp_path / "b.sqlite")) == head
    assert said("phase", "list") == ""
    assert "red" in said("team", "list")
    with Store(f"sqlite:///{tmp_path / 'other' / 'challenge.sqlite'}").write() as session:
        session.execute(update(AuditEntryRow).where(AuditEntryRow.id == 1).values(actor="nobody"))
    result = run("audit")
    assert result.exit_code == 1 and "broken at entry 1" in result.output


def test_what_is_over_is_deleted(data: Path) -> None:
    archive = data / "archives" / f"{'a' * 64}.zip"
    archive.parent.mkdir(parents=True)
    archive.write_bytes(b"")
    os.utime(archive, (0, 0))
    assert isinstance(run("collect").exception, InputError) and archive.exists()  # no database: nothing is known
    said("phase", "apply")
    assert said("collect") == str(archive) and not archive.exists()


def test_environments_are_listed(data: Path) -> None:
    assert "python3.11-numpy  not built" in said("environment", "list")
    assert isinstance(run("environment", "build", "perl").exception, InputError)


def test_options_after_the_name_of_an_environment_are_pips(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[object] = []

    def build(name: str, folder: Path, options: Sequence[str], wheels: Path | None) -> Environment:
        assert wheels is None
        asked.extend((name, folder, *options))
        return Environment(name, folder / "python", folder, ())

    monkeypatch.setattr(environments, "build_environment", build)
    said("environment", "build", "python3.11-torch-cpu", "--extra-index-url", "file:///wheels", "--no-deps")
    assert asked == ["python3.11-torch-cpu", data / "environments", "--extra-index-url", "file:///wheels", "--no-deps"]


@pytest.mark.parametrize(
    ("options", "scheduler"),
    [
        ("", "tcp://set:1"),
        ("--executor dask --scheduler tcp://named:2", "tcp://named:2"),
        ("--executor local", ""),
        ("--executor dask", "tcp://set:1"),
        ("--scheduler tcp://named:2", None),
        ("--executor local --scheduler tcp://named:2", None),
    ],
)
def test_workers_are_chosen_as_for_eval(
    data: Path, monkeypatch: pytest.MonkeyPatch, options: str, scheduler: str | None
) -> None:
    asked: list[str] = []

    def ended(_: Store, settings: ServerSettings) -> NoReturn:
        asked.append(settings.work.scheduler)
        raise InputError("asked enough")

    monkeypatch.setattr(serve_command, "Supervisor", ended)
    monkeypatch.setenv("MDRIVE_WORK__SCHEDULER", "tcp://set:1")
    before = signal.getsignal(signal.SIGTERM)
    try:
        result = CliRunner().invoke(serve, options.split())
    finally:
        signal.signal(signal.SIGTERM, before)
    expected = "asked enough" if scheduler is not None else "expected --scheduler with dask and only then"
    assert isinstance(result.exception, InputError) and expected in str(result.exception)
    assert asked == ([scheduler] if scheduler is not None else [])


def test_a_suite_that_is_not_there_is_said_before_anything_listens(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (data.parent / "server.toml").write_text(SETTINGS.replace('"interdrive"', '"/nowhere"'))
    before = signal.getsignal(signal.SIGTERM)
    try:
        result = CliRunner().invoke(serve, [])
    finally:
        signal.signal(signal.SIGTERM, before)
    assert isinstance(result.exception, InputError) and "/nowhere" in str(result.exception)


@pytest.mark.full
def test_a_server_starts_answers_and_ends(data: Path, tmp_path: Path) -> None:
    with_environment(ServerSettings(data=data))
    with served(tmp_path, "--settings", str(tmp_path / "server.toml"), "--data", str(data)) as (address, process, log):
        assert httpx.get(f"{address}/api/v1/health", timeout=60).json()["status"] == "ok"
        assert httpx.get(f"{address}/api/v1/phases", timeout=60).json()["items"][0]["id"] == "warm-up"
        headers = {"Authorization": f"Bearer {said('team', 'create', 'red')}"}
        form = {"phase": "warm-up", "track": "single-agent", "name": "method"}
        files = {"archive": ("team.zip", archive_samples.packed(archive_samples.GOOD))}
        sent = httpx.post(f"{address}/api/v1/submissions", headers=headers, data=form, files=files, timeout=60).json()
        assert (sent["state"], sent["progress"]) == ("queued", {"queued": len(load_suite("interdrive@0").scenarios)}), (
            sent
        )
        assert sent["evaluator"]["suite"] == load_suite("interdrive@0").checksum()
        process.send_signal(signal.SIGTERM)
        assert process.wait(60) == 0, log.read_text()


SERVE = (
    "from server.cli import limited_protocol, serve_command; limited_protocol.REQUEST_S = 2.0; serve_command.serve()"
)
"""A connection without a request is closed after two seconds, not twenty."""


@contextmanager
def served(folder: Path, *options: str) -> Generator[tuple[str, "subprocess.Popen[bytes]", Path]]:
    """A real server, started in `folder` as a user would; its address, process and what it said."""
    log = folder / "log"
    environment = {name: value for name, value in os.environ.items() if not name.startswith("MDRIVE_")}
    environment["MDRIVE_WORK__PROCESSES"] = "0"
    command = [sys.executable, "-c", SERVE, "--port", "0", *options]
    with log.open("wb") as file:
        process = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT, cwd=folder, env=environment)
    try:
        deadline_s = time.monotonic() + 120
        while "running on http://" not in (text := log.read_text()):
            assert process.poll() is None and time.monotonic() < deadline_s, text
            time.sleep(0.1)
        yield text.split("running on ")[1].split()[0], process, log
    finally:
        process.kill()
        process.wait()


def test_from_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One phase, and what is missing is said; a second server of the folder is refused; Ctrl-C ends it.

    Simulations are the workers': what breaks SUMO must not take the server along.
    """
    monkeypatch.chdir(tmp_path)
    before = signal.getsignal(signal.SIGTERM)
    with served(tmp_path) as (address, process, log):
        assert "using one phase, warm-up, on the public suite interdrive" in log.read_text()
        assert "environment build python3.11-numpy" in log.read_text()
        phases = httpx.get(f"{address}/api/v1/phases", timeout=60).json()["items"]
        assert [(each["id"], each["suite"], each["public"], each["open"]) for each in phases] == [
            ("warm-up", "interdrive@0", True, True)
        ]
        assert "libsumo" not in Path(f"/proc/{process.pid}/maps").read_text()
        port = address.rpartition(":")[2]
        try:
            again = CliRunner().invoke(serve, ["--port", port])
            elsewhere = CliRunner().invoke(serve, ["--port", port, "--data", "other"])
        finally:
            signal.signal(signal.SIGTERM, before)
        assert isinstance(again.exception, InputError) and f"served by process {process.pid};" in str(again.exception)
        assert isinstance(elsewhere.exception, InputError) and f"port {port}: Address" in str(elsewhere.exception)
        with socket.create_connection(("127.0.0.1", int(port))) as silent:
            silent.settimeout(60)
            assert silent.recv(1) == b"", "a connection without a request is closed"
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 0, log.read_text()
        assert "Traceback" not in log.read_text()


def test_phases_are_not_applied_unless_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MDRIVE_DATA", str(tmp_path))
    monkeypatch.delenv("MDRIVE_SETTINGS", raising=False)
    result = run("phase", "apply")
    assert isinstance(result.exception, InputError) and "give --settings" in str(result.exception)


def test_every_command_has_a_line_of_its_own() -> None:
    groups = {"": PLUG_IN_GROUP, "study": f"{PLUG_IN_GROUP.rpartition('.')[0]}.study_commands"}
    told = {group: CliRunner().invoke(main, [*group.split(), "--help"]).output for group in groups}
    for name, line in COMMANDS.items():
        group, _, word = name.rpartition(" ")
        assert f"  {word} " in told[group] and line[:30] in told[group], name
    found = {
        f"{group} {name}".strip()
        for group, entry_points in groups.items()
        for name, plug_in in find_plug_ins(entry_points).items()
        if plug_in.module.startswith("server.")
    }
    assert found == {*COMMANDS}


def test_the_loop_is_asyncio_s_and_no_connection_leaves_the_protocol_that_counts_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """uvloop would not refuse connections, and WebSockets, of which the server has none, would not be counted."""
    loops: list[object] = []

    class Stub:
        started = True

        def __init__(self, config: uvicorn.Config) -> None:
            loops.extend((config.loop, config.ws))

        def run(self, sockets: list[socket.socket]) -> None:
            assert [type(one) for one in sockets] == [LimitedListener]

    monkeypatch.setattr(serve_command, "_Server", Stub)
    monkeypatch.setattr(sys, "setswitchinterval", lambda _: None)
    monkeypatch.setattr(serve_command, "raise_open_files", lambda connections: connections)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        serve_command._run(FastAPI(), ServerSettings(data=tmp_path), listener)
    assert loops == ["asyncio", "none"]
