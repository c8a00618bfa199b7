"""A SQLite file that is cut off, damaged or of another program: `serve` and `admin` say so, with exit code 2."""

import random
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from testing.sampling import sampled

from mdrive_sumo.cli import main
from server.settings import ServerSettings
from server.store import Store, StoreUnavailable, audit, teams


@pytest.fixture(scope="module")
def backup(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A database with some teams in one file, without a write-ahead log."""
    data = tmp_path_factory.mktemp("data")
    for name in ("red", "blue"):
        assert run(data, "admin", "team", "create", name).exit_code == 0
    assert run(data, "admin", "backup", data / "b.sqlite").exit_code == 0
    return (data / "b.sqlite").read_bytes()


def run(data: Path, command: str, *words: object) -> Result:
    return CliRunner().invoke(main, [command, "--data", str(data), *map(str, words)])


def place(data: Path, content: bytes) -> Path:
    data.mkdir(exist_ok=True)
    file = Path(str(Store(ServerSettings(data=data).database_url).url.database))
    file.write_bytes(content)
    return file


def alien(folder: Path) -> bytes:
    with closing(sqlite3.connect(folder / "alien.sqlite")) as connection:
        connection.execute("CREATE TABLE bookmarks (id)")
        connection.commit()
    return (folder / "alien.sqlite").read_bytes()


COMMANDS = (("serve", "--port", "0"), ("admin", "team", "list"), ("admin", "audit"), ("admin", "phase", "list"))


def refused(data: Path, words: tuple[object, ...]) -> str:
    done = run(data, str(words[0]), *words[1:])
    assert done.exit_code == 2, (words, done.exit_code, done.output, done.exception)
    assert isinstance(done.exception, SystemExit)
    (sentence,) = [line for line in done.stderr.splitlines() if line]
    return sentence.removeprefix("Error: ")


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("damage", ["text", "header only", "cut off", "schema", "another program"])
def test_a_damaged_database_costs_a_sentence(
    damage: str, command: tuple[str, ...], backup: bytes, tmp_path: Path
) -> None:
    content, found = {
        "text": (b"not a database" * 100, "found: file is not a database; restore a backup"),
        "header only": (backup[:100], "found: "),
        "cut off": (backup[: len(backup) // 2], "found: "),
        "schema": (backup.replace(b"CREATE TABLE teams", b"CREATE TABLE \xff\xff\xff\xff\xff"), "found: "),
        "another program": (alien(tmp_path), "expected one of a challenge, found another program's with 'bookmarks'"),
    }[damage]
    file = place(tmp_path / "data", content)
    sentence = refused(tmp_path / "data", command)
    assert sentence.startswith(f"database: {file}: expected ")
    assert found in sentence
    assert file.read_bytes() == content


@pytest.mark.parametrize("damage", ["text", "cut off", "another program"])
def test_a_damaged_backup_costs_a_sentence(damage: str, backup: bytes, tmp_path: Path) -> None:
    content = {"text": b"nothing" * 99, "cut off": backup[:9000], "another program": alien(tmp_path)}[damage]
    (tmp_path / "b.sqlite").write_bytes(content)
    sentence = refused(tmp_path / "data", ("admin", "restore", tmp_path / "b.sqlite"))
    assert sentence.startswith(f"{tmp_path / 'b.sqlite'}: expected a backup written by `mdrive-sumo admin backup`")


def test_a_database_of_zero_bytes_is_a_new_one(tmp_path: Path) -> None:
    place(tmp_path / "data", b"")
    assert run(tmp_path / "data", "admin", "team", "create", "red").exit_code == 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", sampled(range(12), range(5)))
def test_flipped_bytes_are_a_sentence_or_harmless(seed: int, backup: bytes, tmp_path: Path) -> None:
    draws = random.Random(seed)
    content = bytearray(backup)
    for _ in range(draws.choice((1, 5, 50))):
        content[draws.randrange(len(content))] = draws.randrange(256)
    for words in (("team", "list"), ("audit", "--list"), ("backup", tmp_path / "c.sqlite")):
        place(tmp_path / "data", bytes(content))
        done = run(tmp_path / "data", "admin", *words)
        assert done.exit_code in (0, 1, 2), (words, done.exception)
        assert done.exception is None or isinstance(done.exception, SystemExit), done.exception


def test_a_file_that_is_damaged_while_it_is_open_is_unavailable(tmp_path: Path) -> None:
    """Requests get 503 and the reason goes to the log."""
    store = Store(f"sqlite:///{tmp_path / 'c.sqlite'}")
    store.migrate()
    with store.write() as session:
        teams.create(session, "red", 0)
    store.close()
    with (tmp_path / "c.sqlite").open("r+b") as file:
        file.seek(4096)
        file.write(b"\xff" * 200_000)
    with pytest.raises(StoreUnavailable, match="the database is damaged: "), store.read() as session:
        audit.verify_chain(session)
        teams.list_teams(session)
    store.close()
