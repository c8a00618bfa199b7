"""The data folder: private, and served by one process whatever its database is."""

import os
import stat
from contextlib import ExitStack
from pathlib import Path

import pytest

from mdrive_sumo.core.errors import InputError
from server.cli.data_folder import lock_data_folder
from server.settings import ServerSettings
from server.store import Store
from server.store.backup import write_backup

POSTGRESQL = "postgresql://mdrive@nowhere/x"


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def test_folder_database_and_backup_are_for_their_owner_only(tmp_path: Path) -> None:
    old_mask = os.umask(0)
    try:
        settings = ServerSettings(data=tmp_path / "data")
        with lock_data_folder(settings):
            store = Store(settings.database_url)
            store.migrate()
            with store.write():
                pass
            write_backup(store, tmp_path / "backup.sqlite")
            files = sorted(settings.data.glob("challenge.sqlite*"))
            assert {path.name for path in files} >= {"challenge.sqlite", "challenge.sqlite-wal"}
            assert {mode(path) for path in files if path.suffix != ".lock"} == {0o600}
            store.close()
    finally:
        os.umask(old_mask)
    assert (mode(settings.data), mode(tmp_path / "backup.sqlite")) == (0o700, 0o600)


def test_wide_modes_of_before_are_corrected(tmp_path: Path) -> None:
    settings = ServerSettings(data=tmp_path / "data")
    settings.data.mkdir(mode=0o755)
    (settings.data / "challenge.sqlite").touch(mode=0o644)
    with lock_data_folder(settings):
        store = Store(settings.database_url)
        store.migrate()
        store.close()
    assert (mode(settings.data), mode(settings.data / "challenge.sqlite")) == (0o700, 0o600)


def locked_by(tmp_path: Path, first: ServerSettings, second: ServerSettings) -> bool:
    """Whether the first server keeps the second from starting."""
    with ExitStack() as stack:
        stack.enter_context(lock_data_folder(first))
        try:
            stack.enter_context(lock_data_folder(second))
        except InputError as error:
            assert f"is being served by process {os.getpid()}" in str(error)
            return True
    return False


def test_one_process_serves_a_folder_and_a_database(tmp_path: Path) -> None:
    def settings(folder: str, database: str = "") -> ServerSettings:
        return ServerSettings(data=tmp_path / folder, database=database)

    by_url = f"sqlite:///{tmp_path / 'elsewhere.sqlite'}"
    assert locked_by(tmp_path, settings("a"), settings("a"))
    assert locked_by(tmp_path, settings("a", by_url), settings("a", by_url))
    assert locked_by(tmp_path, settings("a", by_url), settings("b", by_url))
    assert locked_by(tmp_path, settings("a"), settings("b", f"sqlite:///{tmp_path / 'a' / 'challenge.sqlite'}"))
    assert locked_by(tmp_path, settings("a", POSTGRESQL), settings("a", POSTGRESQL))
    assert not locked_by(tmp_path, settings("a", POSTGRESQL), settings("b", POSTGRESQL))
    assert not locked_by(tmp_path, settings("a", by_url), settings("b"))


def test_several_machines_may_share_a_folder_with_postgresql(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = ServerSettings(data=tmp_path / "a", database=POSTGRESQL)
    with ExitStack() as stack:
        for machine in ("one", "two"):
            monkeypatch.setattr("server.cli.data_folder.socket.gethostname", lambda machine=machine: machine)
            stack.enter_context(lock_data_folder(settings))
        with pytest.raises(InputError, match="is being served"):
            stack.enter_context(lock_data_folder(ServerSettings(data=tmp_path / "a")))
