"""EpisodeProcess: an EpisodeStepper in a process of its own, and `LocalEpisodes`: one in this process.

libsumo holds one simulation a process, so each environment has its process. Actions and results lie in memory that both
share; over the connection go single words, and infos when an episode begins or ends.
"""

import json
import mmap
import os
import pickle
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from multiprocessing.reduction import recv_handle, send_handle
from typing import Any, Protocol

from mdrive_sumo.core.errors import InputError, MdriveError, WorldError
from mdrive_sumo.rl.env_settings import EnvSettings, EpisodeChoice
from mdrive_sumo.rl.episode_stepper import EpisodeStepper, SlotInfo, describe_shape
from mdrive_sumo.rl.slot_arrays import SlotArrays, SlotShape, count_bytes
from mdrive_sumo.runs.fork_server import ForkServer

_STEP = b"step"
_READY = b"ready"
START_LIMIT_S = 120.0
"""Time in which the fork server imports and forks, and the process lays out its arrays; a second on an idle machine."""


class LostProcessError(MdriveError):
    """The process of an environment has died: killed, or out of memory."""


class Episodes(Protocol):
    """Episodes one after the other, whose actions and results are in `arrays`."""

    arrays: SlotArrays

    def reset(self, episode: EpisodeChoice) -> dict[int, SlotInfo]:
        """See EpisodeStepper."""
        ...

    def step(self) -> dict[int, SlotInfo]:
        """See EpisodeStepper."""
        ...

    def close(self) -> None:
        """End it; never raises."""
        ...


class LocalEpisodes(EpisodeStepper):
    """Episodes in this process, which can simulate one at a time."""

    def __init__(self, settings: EnvSettings) -> None:
        self.arrays = SlotArrays.lay_out(describe_shape(settings, settings.slots))
        super().__init__(settings, self.arrays)


class EpisodeProcess:
    """Episodes in a child process. Its methods raise LostProcessError if that has died, and what the child raises."""

    def __init__(self, settings: EnvSettings, server: ForkServer | None = None) -> None:
        """server: forks the process, and belongs to the caller; None: one of its own."""
        shape = describe_shape(settings, settings.slots)
        self._owns_server = server is None
        self._server = ForkServer(serve_episodes) if server is None else server
        memory = os.memfd_create("mdrive-sumo-slots")
        os.ftruncate(memory, count_bytes(shape))
        self.arrays = SlotArrays.lay_out(shape, mmap.mmap(memory, count_bytes(shape)))
        self._connection, theirs = Pipe()
        self._state, state = Pipe()
        self._server.start_worker(theirs, state)
        theirs.close()
        state.close()
        try:
            self._await(self._state)
            self.process_id: int = self._receive(self._state)
            """Of the child."""
            self._send_memory(memory)
            self._send(pickle.dumps((settings, shape)))
            self._await(self._connection)
            self._receive(self._connection, is_pickled=False)
        except MdriveError:
            self.close()
            raise
        finally:
            os.close(memory)

    def reset(self, episode: EpisodeChoice) -> dict[int, SlotInfo]:
        """See EpisodeStepper."""
        self.send_reset(episode)
        return self.receive()

    def step(self) -> dict[int, SlotInfo]:
        """See EpisodeStepper."""
        self.send_step()
        return self.receive()

    def send_reset(self, episode: EpisodeChoice) -> None:
        """Ask for `reset`, whose result `receive` returns."""
        self._send(json.dumps([episode.scenario, episode.seed, episode.suite]).encode())

    def send_step(self) -> None:
        """Ask for `step`, whose result `receive` returns."""
        self._send(_STEP)

    def receive(self) -> dict[int, SlotInfo]:
        """Wait for the result of what was asked for."""
        answer = self._receive(self._connection, is_pickled=False)
        if not answer:
            return {}
        content = json.loads(answer)
        if "infos" in content:
            return {int(slot): info for slot, info in content["infos"].items()}
        raise (InputError if content["is_input"] else WorldError)(content["error"])

    def close(self) -> None:
        """End the process; never raises."""
        self._connection.close()
        self._state.close()
        if self._owns_server:
            self._server.end()

    def _send(self, words: bytes) -> None:
        try:
            self._connection.send_bytes(words)
        except OSError:
            raise LostProcessError(f"environment: its process has died{self._explain()}") from None

    def _send_memory(self, memory: int) -> None:
        try:
            send_handle(self._connection, memory, self.process_id)
        except OSError:
            raise LostProcessError(f"environment: its process has died{self._explain()}") from None

    def _receive(self, connection: Connection, *, is_pickled: bool = True) -> Any:
        try:
            return connection.recv() if is_pickled else connection.recv_bytes()
        except (EOFError, OSError):
            raise LostProcessError(f"environment: its process has died{self._explain()}") from None

    def _await(self, connection: Connection) -> None:
        """Wait until the process says something. Raises LostProcessError if it takes longer than any start does."""
        if not connection.poll(START_LIMIT_S):
            raise LostProcessError(f"environment: expected its process to start within {START_LIMIT_S:g} s, found none")

    def _explain(self) -> str:
        reason = self._server.find_start_failure()
        return f": {reason}" if reason else ""


def serve_episodes(connection: Connection) -> None:
    """Serve an EpisodeProcess until it closes the connection."""
    try:
        memory = recv_handle(connection)
        settings, shape = _read_settings(connection)
    except EOFError:  # it left before it had said anything
        return
    stepper = EpisodeStepper(settings, SlotArrays.lay_out(shape, mmap.mmap(memory, count_bytes(shape))))
    connection.send_bytes(_READY)
    while True:
        try:
            words = connection.recv_bytes()
        except EOFError:
            stepper.close()
            return
        try:
            infos = stepper.step() if words == _STEP else stepper.reset(EpisodeChoice(*json.loads(words)))
        except (InputError, WorldError) as error:
            connection.send_bytes(json.dumps({"error": str(error), "is_input": isinstance(error, InputError)}).encode())
            continue
        connection.send_bytes(json.dumps({"infos": infos}).encode() if infos else b"")


def _read_settings(connection: Connection) -> tuple[EnvSettings, SlotShape]:
    return pickle.loads(connection.recv_bytes())
