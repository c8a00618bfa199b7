"""Where the frames of an episode come from: the simulators (`SimulatedFrames`), or a recording in open loop."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Protocol

from mdrive_sumo.actors import ScriptedActors
from mdrive_sumo.contract import Control
from mdrive_sumo.core.frozen import build_frozen
from mdrive_sumo.core.state import Actors, EgoState, End, Frame, Kind, WorldState
from mdrive_sumo.loop.episode_config import VEHICLE, EpisodeConfig
from mdrive_sumo.scoring import criteria
from mdrive_sumo.vehicle import contact, dynamics


class SteppedWorld(Protocol):
    """The simulator of everything but CAVs and scripted actors: `sumo.SumoWorld`, or a fake in tests."""

    def start(self, egos: Mapping[str, EgoState], scripted: Actors) -> WorldState:
        """Place CAVs and scripted actors, and return the state of everything else in frame 0."""
        ...

    def advance(self, egos: Mapping[str, EgoState], scripted: Actors, struck: Collection[str]) -> WorldState:
        """Place CAVs and scripted actors for the next tick, advance everything else by one tick and return its state.

        CAVs that are not named leave the world. `struck`: ids of the actors that a CAV touched in the last frame.
        """
        ...


class FrameSource(Protocol):
    """The frames of one episode, one after the other, and when its CAVs end."""

    @property
    def dimensions(self) -> Mapping[str, tuple[float, float]]:
        """(length, width) [m] of every CAV, in the order of the scenario file."""
        ...

    def start(self) -> Frame:
        """Return the first frame."""
        ...

    def advance(self, frame: Frame, controls: Mapping[str, Control]) -> Frame:
        """Return the frame after `frame`, in which the CAVs in `controls` are active."""
        ...

    def find_ends(self, frame: Frame, active: Sequence[str]) -> Mapping[str, End]:
        """Return how the active CAVs end that end in this frame, in the order of `active`."""
        ...


class SimulatedFrames:
    """Frames of the simulators: dynamics and contacts of the CAVs, scripted actors, and SUMO or another world."""

    def __init__(self, config: EpisodeConfig, world: SteppedWorld) -> None:
        """world: not started yet."""
        scenario = config.scenario
        self._config, self._world = config, world
        self._time_limits = criteria.compute_time_limit_ticks(scenario)
        self._references = {ego.id: criteria.build_route_reference(ego) for ego in scenario.egos}
        self._progress = {ego.id: criteria.RouteProgress() for ego in scenario.egos}
        self._vehicle_states = {
            ego.id: dynamics.initial_state(ego.start.x, ego.start.y, ego.start.yaw, ego.start_speed)
            for ego in scenario.egos
        }
        self._vehicle = replace(VEHICLE, grip=config.road_grip)
        self._vehicles = dict.fromkeys(self._vehicle_states, self._vehicle)
        self._walls = contact.build_walls(building.outline for building in config.roads.buildings)
        self._scripted = ScriptedActors(scenario, config.roads, config.options.actor_mode)

    @property
    def dimensions(self) -> Mapping[str, tuple[float, float]]:
        """(length, width) [m]: all CAVs are the same vehicle."""
        return dict.fromkeys(self._vehicles, (VEHICLE.length, VEHICLE.width))

    @property
    def vehicle_states(self) -> Mapping[str, dynamics.VehicleState]:
        """The complete state of every CAV in the latest frame, before that is rounded; of an ended one its last."""
        return MappingProxyType(self._vehicle_states)

    def start(self) -> Frame:
        """Return frame 0: every CAV on its start with its start speed."""
        states = _ego_states(self._vehicle_states)
        around = self._world.start(states, self._scripted.present)
        return Frame(0, states, around.actors.merge(self._scripted.present), around.signals)

    def advance(self, frame: Frame, controls: Mapping[str, Control]) -> Frame:
        """Move the CAVs by their dynamics, advance the world, then resolve contacts (docs/decisions/022)."""
        before = {ego: self._vehicle_states[ego] for ego in controls}
        after = {ego: dynamics.step(state, controls[ego], self._vehicle) for ego, state in before.items()}
        struck = _find_struck(frame)
        scripted = self._scripted.advance(_leave_out_ended(frame, before), struck)
        around = self._world.advance(_ego_states(after), scripted, struck)
        actors = around.actors.merge(scripted)
        obstacles = contact.build_obstacle_motion(frame.actors, actors)
        settled, contacts = contact.resolve_contacts(before, after, self._vehicles, obstacles, self._walls)
        self._vehicle_states |= after if self._config.pass_through else settled
        states = _ego_states({ego: self._vehicle_states[ego] for ego in after})
        return build_frozen(Frame, frame.tick + 1, states, actors, around.signals, contacts)

    def find_ends(self, frame: Frame, active: Sequence[str]) -> Mapping[str, End]:
        """Return the CAVs that arrived, deviated, are blocked or timed out in this frame (protocol 5 to 7)."""
        ends: dict[str, End] = {}
        for ego in active:
            state = frame.egos[ego]
            self._progress[ego] = criteria.update_progress(
                self._progress[ego], self._references[ego], frame.tick, state.x, state.y, state.speed
            )
            end = criteria.find_end(self._progress[ego], frame.tick, self._time_limits[ego])
            if end is not None:
                ends[ego] = end
        return ends


def _leave_out_ended(frame: Frame, active: Collection[str]) -> Frame:
    """Return the frame without the CAVs that have ended in it."""
    if len(active) == len(frame.egos):
        return frame
    return replace(frame, egos={ego: frame.egos[ego] for ego in active})


def _find_struck(frame: Frame) -> set[str]:
    """Return the ids of the actors that a CAV touches in this frame; they stand for 2 s. Props never move."""
    return {c.other for c in frame.contacts if c.kind != Kind.STATIC and c.other not in frame.egos}


def _ego_states(vehicle_states: Mapping[str, dynamics.VehicleState]) -> dict[str, EgoState]:
    return {ego: dynamics.to_ego_state(state) for ego, state in vehicle_states.items()}
