"""Processes of environments that do not start, or die: one sentence each, and nothing left behind."""

import os
import signal
import time
from collections.abc import Callable, Generator
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path

import pytest
from testing.broken_starts import end_at_once, never_answer

from mdrive_sumo.rl import episode_process
from mdrive_sumo.rl.env_settings import EnvSettings
from mdrive_sumo.rl.episode_process import EpisodeProcess, LostProcessError, serve_episodes
from mdrive_sumo.runs.fork_server import ForkServer

pytestmark = pytest.mark.slow
SETTINGS = EnvSettings(scenarios=("i25_ins_oppo_boulevard",))
Serve = Callable[[Connection], None]


@pytest.fixture
def start_server() -> Generator[Callable[[Serve], ForkServer]]:
    servers: list[ForkServer] = []

    def start(serve: Serve) -> ForkServer:
        servers.append(ForkServer(serve))
        ours, theirs = Pipe()
        told, state = Pipe()
        servers[0].start_worker(theirs, state)
        assert isinstance(told.recv(), int)  # it has imported all and forks
        for connection in (theirs, state, told, ours):
            connection.close()
        return servers[0]

    yield start
    for server in servers:
        server.end()


def test_a_start_that_fails_is_one_sentence(start_server: Callable[[Serve], ForkServer]) -> None:
    with pytest.raises(LostProcessError, match=r"^environment: its process has died$"):
        EpisodeProcess(SETTINGS, start_server(end_at_once))


def test_a_start_that_hangs_is_one_sentence(
    start_server: Callable[[Serve], ForkServer], monkeypatch: pytest.MonkeyPatch
) -> None:
    server = start_server(never_answer)
    monkeypatch.setattr(episode_process, "START_LIMIT_S", 0.5)
    with pytest.raises(LostProcessError, match=r"^environment: expected its process to start within 0.5 s, found none"):
        EpisodeProcess(SETTINGS, server)


def test_a_process_that_is_killed_is_one_sentence_and_the_server_forks_another(
    start_server: Callable[[Serve], ForkServer],
) -> None:
    server = start_server(serve_episodes)
    process = EpisodeProcess(SETTINGS, server)
    os.kill(process.process_id, signal.SIGKILL)
    with pytest.raises(LostProcessError, match=r"^environment: its process has died$"):
        process.reset(SETTINGS.choose_episode(0, 0, {}))
    process.close()
    another = EpisodeProcess(SETTINGS, server)
    assert another.process_id != process.process_id
    another.close()
    for _ in range(100):  # a process whose owner has closed ends by itself
        if not Path(f"/proc/{another.process_id}").exists():
            return
        time.sleep(0.05)
    pytest.fail("the process of a closed environment is still there")
