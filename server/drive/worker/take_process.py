"""The process of a take: it repeats a take up to a tick; then people drive on, or it is finished, or agents look ahead.

The actions of a tick are in the journal before they take effect, so a killed process loses none. At every step of the
ladder it forks a checkpoint: a copy of itself that waits until another take branches from there.
"""

import os
import pickle
import select
import socket
import sys
import time
import traceback
from typing import NoReturn

from mdrive_sumo.core.clean_text import truncate
from mdrive_sumo.core.errors import InputError, WorldError
from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.report.run_page.losses import list_losses
from mdrive_sumo.runs.takes import HUMAN, Action, DriverChoice, write_take
from mdrive_sumo.scoring import ScenarioResult
from server.drive.message_socket import MessageSocket
from server.drive.simulation_values import CallAnswer, DriveCall, DriveProblem, WhatIfBranch
from server.drive.take_tree import MAX_LOSSES_LENGTH
from server.drive.worker.drive_context import DriveContext
from server.drive.worker.journaled_take import JournaledTake
from server.drive.worker.live_take import LiveTake, find_checkpoint_ticks
from server.drive.worker.motion import pack_motion
from server.drive.worker.orders import (
    CheckpointMade,
    FinishOrder,
    Provenance,
    TakeAlive,
    TakeDropped,
    TakeFinished,
    TakeMode,
    TakeOrder,
    TakeReady,
    TakeRefused,
    WhatIfDone,
)
from server.drive.worker.take_journal import (
    CavAction,
    TakeJournal,
    TickActions,
    list_driver_changes,
    read_journal,
)
from server.drive.worker.take_simulation import TakeDivergedError, TakeSimulation

BACKGROUND_NICE = 15
"""Niceness of what runs beside the take that people drive."""
RETRY_S = 2.0
"""Time after which a full disk is tried again [s]."""
TAKE_IS_OVER = "the take is over; go back to a tick to drive on"
ALIVE_S = 1.0
"""Time between two signs of life [s]."""
POLL_TICKS = 40
"""A repeated drive looks every so many ticks whether its supervisor is still there."""


class _CheckpointForked(BaseException):
    """Unwinds the stack in a new checkpoint: a branch of a branch of a branch must not run on top of them all."""

    def __init__(self, connection: MessageSocket) -> None:
        super().__init__()
        self.connection = connection


def run_take_process(context: DriveContext, order: TakeOrder, connection: MessageSocket) -> NoReturn:
    """Simulate a take from tick 0 in this process, which ends with it. Call it in a fork."""
    code = 0
    simulation: TakeSimulation | None = None
    try:
        while True:
            process = TakeProcess(context, simulation, order, connection)
            try:
                process.run()
                break
            except _CheckpointForked as fork:
                waiting, simulation = fork.connection, process.simulation
            order, connection = wait_for_order(waiting)
    except (EOFError, BrokenPipeError, ConnectionResetError):  # the supervisor has ended, or drops this take
        pass
    except BaseException:  # noqa: BLE001 - a fork must not return into the code of its parent
        traceback.print_exc()
        code = 1
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def wait_for_order(waiting: MessageSocket) -> tuple[TakeOrder, MessageSocket]:
    """Wait in a checkpoint; return, in a fork of it, an order and the connection for it.

    Raises EOFError in the checkpoint once the supervisor closes the connection.
    """
    while True:
        for data in waiting.receive():
            order, descriptor = pickle.loads(data), waiting.take_descriptor()  # of our own process
            if os.fork() == 0:
                waiting.close()
                return order, MessageSocket(socket.socket(fileno=descriptor))
            os.close(descriptor)


class TakeProcess:
    """Follows one order."""

    def __init__(
        self, context: DriveContext, simulation: TakeSimulation | None, order: TakeOrder, connection: MessageSocket
    ) -> None:
        """simulation: in a tick before or at that of the order; None: a new one."""
        self._journal: TakeJournal | None = None
        self._context, self._order, self._connection = context, order, connection
        self._given_simulation = simulation
        self._alive_s = -ALIVE_S

    def run(self) -> None:
        """Follow the order, and say how it went. Raises EOFError and OSError if the supervisor has ended."""
        try:
            self._say_alive()
            self.simulation = self._given_simulation or TakeSimulation(self._context)
            if self._order.mode in (TakeMode.FINISH, TakeMode.WHAT_IF):
                os.nice(BACKGROUND_NICE)
            self._repeat()
            follow = {
                TakeMode.DRIVE: self._drive,
                TakeMode.FINISH: self._finish_earlier,
                TakeMode.WHAT_IF: self._look_ahead,
                TakeMode.HOLD: self.fork_checkpoint,
            }
            follow[self._order.mode]()
        except TakeDivergedError as error:
            self._connection.send(TakeRefused(str(error), has_diverged=True))
        except (InputError, WorldError) as error:
            self._connection.send(TakeRefused(str(error)))

    def _repeat(self) -> None:
        """Drive the simulation to the tick of the order, tick by tick the same as in its source."""
        simulation, header = self.simulation, self._order.header
        ticks, digests = self._read_source()
        if len(ticks) < header.tick:
            raise InputError(f"tick: expected one of the take, 0 to {len(ticks)}, found {header.tick}")
        is_new = self._given_simulation is None
        simulation.log.replace(ticks, header.entered_tick)
        while simulation.tick < header.tick:
            tick = simulation.tick
            simulation.check(digests.get(tick, ""))
            if not ticks[tick].digest:
                simulation.log.ticks[tick] = TickActions(ticks[tick].cavs, ticks[tick].left, simulation.episode.digest)
            if is_new and self._is_checkpoint_due(tick):
                self.fork_checkpoint()
            simulation.step()
            if simulation.is_done and simulation.tick <= header.tick and self._order.mode != TakeMode.FINISH:
                raise InputError(f"tick: expected one before the end of the take, {simulation.tick}")
            if simulation.is_done:
                break
            if tick % POLL_TICKS == 0:
                self._poll()
        simulation.check(digests.get(header.tick, ""))
        del simulation.log.ticks[header.tick :]
        if is_new and self._is_checkpoint_due(simulation.tick) and self._order.mode == TakeMode.DRIVE:
            self.fork_checkpoint()

    def _read_source(self) -> tuple[list[TickActions], dict[int, str]]:
        """Return the actions of the ticks to repeat, and the digests that are known, by tick."""
        header, context = self._order.header, self._context
        if self._order.source is not None:
            _, ticks = read_journal(self._order.source)
            digests = {tick: one.digest for tick, one in enumerate(ticks)}
        else:
            ticks, digests = [TickActions() for _ in range(header.tick)], {}
            if ticks and context.agents:
                first = {cav: CavAction(Action(choice)) for cav, choice in context.agents.items()}
                ticks[0] = TickActions(first)
        entered = self.simulation.log.entered
        if entered is not None:
            digests |= {tick: entered.find_digest(tick) for tick in range(header.entered_tick + 1)}
        return ticks, digests

    def _is_checkpoint_due(self, tick: int) -> bool:
        every = find_checkpoint_ticks(self._context.setup.checkpoint_s)
        return bool(every) and tick % every == 0 and self._order.mode in (TakeMode.DRIVE, TakeMode.HOLD)

    def fork_checkpoint(self) -> None:
        """Fork a copy that waits in this tick, and pass its socket to the supervisor."""
        ours, theirs = socket.socketpair()
        if os.fork() == 0:
            ours.close()
            self._connection.close()
            if self._journal is not None:
                self._journal.close()
            raise _CheckpointForked(MessageSocket(theirs))
        theirs.close()
        message = CheckpointMade(self._order.header.take, self.simulation.tick)
        self._connection.send(message, (ours.fileno(),))
        ours.close()

    def _poll(self) -> None:
        """Say that it works, and answer; raise EOFError if the supervisor has ended."""
        self._say_alive()
        if select.select([self._connection], [], [], 0.0)[0]:
            self._handle_all()

    def _say_alive(self) -> None:
        now_s = time.monotonic()
        if now_s - self._alive_s >= ALIVE_S:
            self._alive_s = now_s
            self._connection.send(TakeAlive(os.getpid()))

    def _handle_all(self) -> None:
        for data in self._connection.receive():
            self._handle(pickle.loads(data))  # of our own processes

    def _handle(self, message: object) -> None:
        """Answer what comes while no person drives: the motion so far; all else has no meaning then."""
        if isinstance(message, FinishOrder):
            self._may_finish = True
        elif isinstance(message, Provenance):
            self._provenance = message
        elif isinstance(message, DriveCall) and message.name == "load_motion":
            motion = pack_motion(self._order.header.take, self.simulation.frames, self._context.cavs)
            self._connection.send(CallAnswer(message.number, motion))
        elif isinstance(message, DriveCall):
            self._connection.send(CallAnswer(message.number, None, "" if message.name == "pause" else TAKE_IS_OVER))

    _may_finish = False
    _provenance: Provenance | None = None

    # ------------------------------------------------------------------------------------------------------ modes

    def _drive(self) -> None:
        """Let people drive, then score and store the take."""
        header, simulation = self._order.header, self.simulation
        try:
            journal = TakeJournal.create(self._order.journal, header, simulation.log.ticks)
        except OSError as error:
            raise InputError(f"{self._order.journal}: cannot be written: {error.strerror}") from None
        self._journal = journal
        take = JournaledTake(self._context, simulation, self._order, journal)
        drivers = {cav: take.find_driver(cav) for cav in self._context.cavs}
        self._connection.send(TakeReady(header, drivers))
        live = LiveTake(take, self._connection, self.fork_checkpoint)
        live.run()
        self._may_finish, self._provenance = live.may_finish, live.provenance
        if live.is_left and not take.is_driven:
            self._connection.send(TakeDropped(header.take))
            return
        if live.is_left:
            os.nice(BACKGROUND_NICE)
            self._finish_left(take)
        self._store(take)

    def _finish_earlier(self) -> None:
        """Finish a take of an earlier session, whose journal goes on."""
        take = JournaledTake(self._context, self.simulation, self._order, TakeJournal(self._order.journal))
        self._may_finish = True
        self._finish_left(take)
        self._store(take)

    def _finish_left(self, take: JournaledTake) -> None:
        """Let the CAVs of people fail and brake, and agents drive on, until all have ended."""
        while not self._may_finish:
            self._handle_all()
        actions = take.compose_leaving()
        while not self.simulation.is_done:
            try:
                take.advance(actions)
            except OSError as error:
                self._wait_for_room(f"{self._order.journal}: cannot be written: {error.strerror}")
                continue
            actions = TickActions()
            self._poll()

    def _store(self, take: JournaledTake) -> None:
        """Score and write the take. A full disk is tried again until there is room."""
        record, known = self.simulation.finish(), self._provenance or Provenance("unknown", 0.0)
        while True:
            try:
                run = self._context.prepare(self._order.folder, known.device, known.latency_ms)
                result = write_take(run, record)
                break
            except InputError as error:
                self._wait_for_room(str(error))
        take.close()
        ds = {ego.id: ego.ds for ego in result.egos}
        number, last = self._order.header.take, record.ticks - 1
        motion = pack_motion(number, self.simulation.frames, self._context.cavs)
        losses, changes = describe_losses(result), list_driver_changes(self.simulation.log.ticks)
        self._connection.send(TakeFinished(number, last, result.ds, ds, losses, changes, take.left_tick, motion))

    def _wait_for_room(self, text: str) -> None:
        """Say once that a file cannot be written, and wait."""
        if not self._has_told_problem:
            number = self._order.header.take
            self._connection.send(DriveProblem(f"take {number} is not stored yet: {text}; it is tried again"))
            self._has_told_problem = True
        end_s = time.monotonic() + RETRY_S
        self._say_alive()
        while (left_s := end_s - time.monotonic()) > 0:
            if select.select([self._connection], [], [], left_s)[0]:
                self._handle_all()

    _has_told_problem = False

    def _look_ahead(self) -> None:
        """Let an agent drive for some seconds, and send where everything went."""
        order, simulation, origin = self._order, self.simulation, self._context.origin
        people = [cav for cav in simulation.driven_cavs if simulation.find_driver(cav) == HUMAN]
        taken = order.cavs or people or self._context.setup.people
        cavs = {
            cav: CavAction(Action(DriverChoice(order.agent)))
            for cav in simulation.driven_cavs
            if cav in taken or simulation.find_driver(cav) in ("", "recording")
        }
        tracks: dict[str, list[tuple[float, float, float, float]]] = {}
        contacts: list[tuple[int, str, str]] = []
        actions, last = TickActions(cavs), order.header.tick + round(order.seconds * TICKS_PER_SECOND)
        while True:
            frame = simulation.frame
            for cav, ego in frame.egos.items():
                pose = round(ego.x - origin[0], 3), round(ego.y - origin[1], 3), round(ego.yaw, 4), round(ego.speed, 3)
                tracks.setdefault(cav, []).append(pose)
            contacts += [(frame.tick, contact.ego, contact.other) for contact in frame.contacts]
            if frame.tick >= last or simulation.is_done:
                break
            simulation.log.ticks.append(actions)
            actions = TickActions()
            simulation.step()
            self._poll()
        endings = {cav: str(ending.end) for cav, ending in simulation.episode.endings.items()}
        branch = WhatIfBranch(order.agent, order.header.take, order.header.tick, tracks, endings, contacts)
        self._connection.send(WhatIfDone(branch))


def describe_losses(result: ScenarioResult) -> dict[str, str]:
    """Return what cost score, in words, by CAV; without those that lost nothing."""
    cavs = {ego.id for ego in result.egos}
    texts = {ego.id: "; ".join(loss.text for loss in list_losses(ego, cavs, None)) for ego in result.egos}
    clean = {cav: "".join(letter if letter.isprintable() else " " for letter in text) for cav, text in texts.items()}
    return {cav: truncate(text, MAX_LOSSES_LENGTH) for cav, text in clean.items() if text}
