"""TakeSimulation: the episode of a take, tick by tick, with the drivers of all CAVs. A fork copies all of it."""

from collections.abc import Mapping, Sequence

from mdrive_sumo.core.state import Frame
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.loop import EpisodeSimulation, SimulatedFrames, start_agents
from mdrive_sumo.loop.agent_scheduler import AgentScheduler
from mdrive_sumo.loop.open_world import open_world
from mdrive_sumo.runs.takes import DriverChoice, HumanDriver, open_human_driver
from mdrive_sumo.vehicle.dynamics import VehicleState
from server.drive.worker.drive_context import DriveContext
from server.drive.worker.frame_builder import FrameBuilder
from server.drive.worker.take_actions import TakeActions, TakeLog


class TakeDivergedError(Exception):
    """A re-execution is not the drive that it repeats."""

    def __init__(self, tick: int) -> None:
        super().__init__(f"the drive cannot be repeated: it differs from the recorded one before tick {tick}")


class TakeSimulation:
    """One episode, which starts when it is made. The actions of a tick must be in `log` before `step`."""

    def __init__(self, context: DriveContext) -> None:
        """Raises WorldError if the simulator fails, InputError for a damaged recording of the entered run."""
        self.log = TakeLog(context.make_entered_run())
        spec = context.config.agent
        self._drivers: Mapping[str, HumanDriver] = {
            cav: open_human_driver(cav, TakeActions(self.log, cav), spec) for cav in context.cavs
        }
        self.station_names: Mapping[str, str] = {told: name for name, told in context.episode.pseudonyms.items()}
        """Id in the scenario by the id that agents and their texts use."""
        self._world = open_world(context.episode)
        self._world.__enter__()  # it ends with the process
        self._frames = SimulatedFrames(context.episode, self._world)
        self.episode: EpisodeSimulation = start_agents(context.episode, self._frames, self._drivers)
        clock = context.episode.options.clock
        self._scheduler = AgentScheduler(self._drivers, clock, (), self.episode.fail_agent)
        self._observations = self.episode.reset()
        self.frames = FrameBuilder(context.roads, context.origin)
        """The rows of all ticks so far."""
        self.frames.add(self.frame)

    @property
    def tick(self) -> int:
        """The current tick."""
        return self.episode.tick

    @property
    def frame(self) -> Frame:
        """The state of everything in the current tick."""
        return self.episode.frame

    @property
    def is_done(self) -> bool:
        """Whether every CAV has ended."""
        return self.episode.is_done

    @property
    def vehicle_states(self) -> Mapping[str, VehicleState]:
        """The complete state of every CAV, by id."""
        return self._frames.vehicle_states

    @property
    def driven_cavs(self) -> Sequence[str]:
        """The CAVs that have not ended and whose drivers have not failed."""
        return [cav for cav in self.episode.active_egos if cav not in self.episode.failed_agents]

    def find_driver(self, cav: str) -> str:
        """Return who drives a CAV; "" before the first tick."""
        choice = self.find_choice(cav)
        return choice.name if choice is not None else ""

    def find_choice(self, cav: str) -> DriverChoice | None:
        """Return who drives a CAV, with options; None before the first tick."""
        return self._drivers[cav].driver

    def step(self) -> None:
        """Advance by one tick with the actions of the log. Raises WorldError if the simulator fails."""
        tick = self.tick
        replies = self._scheduler.collect_replies(tick, self._observations)
        self._observations = self.episode.step(replies, busy=self._scheduler.find_busy(tick + 1))
        if self.tick > tick:  # else the episode was done with the CAVs of this tick
            self.frames.add(self.frame)

    def check(self, digest: str) -> None:
        """Raise TakeDivergedError unless all ticks so far have this digest; "": it is not known."""
        if digest and digest != self.episode.digest:
            raise TakeDivergedError(self.tick)

    def finish(self) -> EpisodeRecord:
        """Return the recording of the episode, which must be done."""
        return self.episode.finish()
