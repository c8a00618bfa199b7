"""SumoWorld: SUMO in process. Ghosts, egos' doubles and SUMO's own ids stay behind this door."""

# pyright: basic
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, repeat
from types import TracebackType
from typing import Self

import libsumo
import numpy as np

from mdrive_sumo.errors import InputError, WorldError
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.spec import Scenario
from mdrive_sumo.state import DT, Actors, EgoState, Kind, no_actors
from mdrive_sumo.sumo.frames import front_bumper, yaws_from_sumo
from mdrive_sumo.sumo.ghosts import CORRIDOR_M, Ghost, ghosts_of
from mdrive_sumo.sumo.remote import EGO, GHOST, add_remote, add_types, place
from mdrive_sumo.sumo.traffic import Traffic

_position, _angle, _speed = (
    getattr(libsumo.libsumo._libsumo, f"vehicle_get{what}") for what in ("Position", "Angle", "Speed")
)
"""libsumo's own functions below its Python wrappers, which take as long again; called for every vehicle and tick."""
GHOST_TICKS = 5
"""Which lanes an ego overlaps is found every 0.25 s; between, its ghosts move along. SUMO's drivers look less often."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What SUMO drives: background vehicles, and the states of traffic lights by id."""

    actors: Actors
    signals: Mapping[str, str]


class SumoWorld:
    """One simulation; a context manager. SUMO holds one simulation a process, so a second one is refused."""

    def __init__(self, scenario: Scenario, roads: RoadMap, sizes: Mapping[str, tuple[float, float]], seed: int) -> None:
        """`sizes`: (length, width) [m] of every ego. `seed` drives all of SUMO's own randomness."""
        self._scenario, self._roads, self._sizes, self._seed = scenario, roads, sizes, seed
        self._known: dict[str, tuple[float, float]] = {}
        self._present: Sequence[str] = ()
        self._cast = no_actors()
        self._traffic = Traffic(scenario.background)
        self._egos: tuple[str, ...] = ()
        self._ghosts: dict[str, Ghost] = {}
        self._tick = 0
        self._frozen: dict[str, str] | None = None

    def __enter__(self) -> Self:
        if libsumo.isLoaded():
            raise WorldError("SUMO holds one simulation a process, and one is open already")
        try:
            libsumo.start(self._command())
            add_types()
            self._freeze_lights()
            self._traffic.add()
        except libsumo.TraCIException as error:
            libsumo.close()
            raise InputError(f"scenario {self._scenario.id}: SUMO refused it: {error}") from None
        except BaseException:
            libsumo.close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        libsumo.close()

    def _command(self) -> list[str]:
        """SUMO's options (sumo_pitfalls 2.1, 6.1 and 11): no teleports, no collision actions, slow-reacting drivers."""
        action_step = str(self._scenario.background.action_step_s)
        return [
            "sumo", "--net-file", str(self._roads.net_file), "--seed", str(self._seed), "--step-length", str(DT),
            "--default.action-step-length", action_step, "--lanechange.duration", "2",
            "--time-to-teleport", "-1", "--time-to-teleport.disconnected", "-1", "--time-to-teleport.ride", "-1",
            "--collision.action", "none", "--intermodal-collision.action", "none", "--collision.check-junctions",
            "--no-step-log", "--no-warnings", "--duration-log.disable",
        ]  # fmt: skip

    def _freeze_lights(self) -> None:
        """`frozen-green`: every link shows g. With G background cars would take each other's right of way."""
        if self._scenario.signals != "frozen-green":
            return
        self._frozen = {}
        for light in sorted(libsumo.trafficlight.getIDList()):
            state = "g" * len(libsumo.trafficlight.getRedYellowGreenState(light))
            libsumo.trafficlight.setRedYellowGreenState(light, state)
            self._frozen[light] = state

    def start(self, egos: Mapping[str, EgoState], scripted: Actors) -> Surroundings:
        """Places the egos and makes the first step, so that vehicles departing at 0 s are there in frame 0."""
        return self.advance(egos, scripted, ())

    def advance(self, egos: Mapping[str, EgoState], scripted: Actors, struck: Collection[str]) -> Surroundings:
        """The only deed: places egos and ghosts, holds struck vehicles, steps SUMO, and reads what it drives.

        Egos that are no longer named leave the world. Raises WorldError where SUMO fails or teleports a vehicle.
        """
        try:
            self._place_egos(egos)
            self._place_ghosts(egos)
            self._traffic.hold(struck, self._tick)
            libsumo.simulationStep()
            self._tick += 1
            if libsumo.simulation.getStartingTeleportNumber():
                raise WorldError(
                    f"SUMO teleported {libsumo.simulation.getStartingTeleportIDList()} at step {self._tick}"
                )
            return Surroundings(self._actors(), self._signals())
        except libsumo.TraCIException as error:
            raise WorldError(f"SUMO failed at step {self._tick}: {error}") from error

    def _place_egos(self, egos: Mapping[str, EgoState]) -> None:
        for gone in [ego for ego in self._egos if ego not in egos]:
            libsumo.vehicle.remove(EGO + gone)
        for ego_id in [ego for ego in egos if ego not in self._egos]:
            add_remote(EGO + ego_id, EGO, self._sizes[ego_id], self._edge_at(egos[ego_id]), self._roads)
        self._egos = tuple(egos)
        for ego_id, ego in egos.items():
            x, y = front_bumper(ego.x, ego.y, ego.yaw, self._sizes[ego_id][0])
            place(EGO + ego_id, x, y, ego.yaw, ego.speed)

    def _edge_at(self, ego: EgoState) -> str:
        return self._roads.driving[int(self._roads.nearest(np.array([[ego.x, ego.y]])).lane[0])].edge

    def _place_ghosts(self, egos: Mapping[str, EgoState]) -> None:
        if not self._known and not self._scenario.background.vehicles:
            return  # nobody is there to see them
        if self._tick % GHOST_TICKS == 0:
            wanted = dict(ghost for ego_id, ego in egos.items() for ghost in self._ghosts_of(ego_id, ego).items())
        else:
            wanted = {
                name: ghost.moved() for name, ghost in self._ghosts.items() if ghost.body.removeprefix(EGO) in egos
            }
        for name in [name for name in self._ghosts if name not in wanted]:
            libsumo.vehicle.remove(name)
        for name, ghost in wanted.items():
            if name not in self._ghosts:
                add_remote(name, GHOST, (ghost.length, CORRIDOR_M), ghost.lane.edge, self._roads)
            elif ghost.length != self._ghosts[name].length:
                libsumo.vehicle.setLength(name, ghost.length)
            x, y = ghost.lane.centre.at(ghost.front_s)
            hint = (ghost.lane.edge, ghost.lane.index)
            place(name, x, y, ghost.lane.centre.yaw_at(ghost.front_s), ghost.speed, hint)
        self._ghosts = wanted

    def _ghosts_of(self, ego_id: str, ego: EgoState) -> dict[str, Ghost]:
        name = EGO + ego_id
        seen_on = libsumo.vehicle.getLaneID(name) if self._tick else ""
        return ghosts_of(name, (ego.x, ego.y, ego.yaw), ego.speed, self._sizes[ego_id], seen_on, self._roads)

    def _actors(self) -> Actors:
        """One pass of direct getters (sumo_pitfalls 9.1), then array arithmetic."""
        present = libsumo.vehicle.getIDList()
        if present != self._present:
            self._present, self._cast = present, self._casting(present)
        cast = self._cast
        ids = cast.ids
        if not ids:
            return cast
        places = chain.from_iterable(map(_position, ids, repeat(False)))
        front = np.fromiter(places, dtype=np.float64, count=2 * len(ids)).reshape(-1, 2).T
        yaw = yaws_from_sumo(np.array(list(map(_angle, ids))))
        speed = np.array(list(map(_speed, ids)))
        half = cast.length / 2
        x, y = front[0] - np.cos(yaw) * half, front[1] - np.sin(yaw) * half
        return Actors(ids, cast.kind, x, y, yaw, speed, cast.length, cast.width)

    def _casting(self, present: Sequence[str]) -> Actors:
        """Who of the vehicles in SUMO is background, with sizes; poses are filled in on every tick."""
        ids = tuple(sorted(i for i in present if not i.startswith((EGO, GHOST))))
        for new in ids:
            if new not in self._known:
                self._known[new] = (libsumo.vehicle.getLength(new), libsumo.vehicle.getWidth(new))
        size = np.array([self._known[i] for i in ids]).reshape(-1, 2)
        nil = np.zeros(len(ids))
        return Actors(ids, np.full(len(ids), Kind.VEHICLE, dtype=np.uint8), nil, nil, nil, nil, size[:, 0], size[:, 1])

    def _signals(self) -> Mapping[str, str]:
        if self._frozen is not None:
            return self._frozen
        lights = libsumo.trafficlight
        return {light: lights.getRedYellowGreenState(light) for light in sorted(lights.getIDList())}
