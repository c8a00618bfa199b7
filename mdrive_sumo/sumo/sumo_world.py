"""SumoWorld: SUMO in process. Ghosts, egos' doubles and SUMO's own ids stay behind this door."""

# pyright: basic
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from itertools import chain, repeat
from types import TracebackType
from typing import Self

import libsumo
import numpy as np

from mdrive_sumo.core.errors import InputError, WorldError
from mdrive_sumo.core.state import DT, Actors, EgoState, Kind, WorldState
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.sumo.background_traffic import Traffic
from mdrive_sumo.sumo.conflict import Mover, mover_of
from mdrive_sumo.sumo.friction import friction_options, make_slippery
from mdrive_sumo.sumo.ghost_manager import Mirror
from mdrive_sumo.sumo.ghost_placement import Body
from mdrive_sumo.sumo.lane_change import shifted
from mdrive_sumo.sumo.log_replay import Replay
from mdrive_sumo.sumo.placed_vehicles import EGO, add_remote, add_types, place
from mdrive_sumo.sumo.scripted_bodies import Scripted, bodies_of, names_of
from mdrive_sumo.sumo.sumo_frames import front_bumper, yaws_from_sumo

_position, _angle, _speed = (
    getattr(libsumo.libsumo._libsumo, f"vehicle_get{what}") for what in ("Position", "Angle", "Speed")
)
"""libsumo's own functions below its Python wrappers, which take as long again; called for every vehicle and tick."""
ROLLING = (Kind.VEHICLE, Kind.CYCLIST)


class SumoWorld:
    """One simulation; a context manager. SUMO holds one simulation a process, so a second one is refused."""

    def __init__(
        self,
        scenario: Scenario,
        roads: RoadMap,
        sizes: Mapping[str, tuple[float, float]],
        seed: int,
        grip: float = 1.0,
    ) -> None:
        """`sizes`: (length, width) [m] of every ego. `seed` drives all of SUMO's own randomness.

        `grip`: share in (0, 1] of a dry road's friction.
        """
        self._scenario, self._roads, self._sizes, self._seed = scenario, roads, sizes, seed
        self._grip = grip
        self._known: dict[str, tuple[float, float]] = {}
        self._present: Sequence[str] = ()
        self._cast = self._last = Actors.empty()
        self._traffic = Traffic(scenario.background, roads)
        self._egos: tuple[str, ...] = ()
        self._replay = Replay(scenario.background, roads)
        self._mirror = Mirror(roads)
        self._scripted = Scripted(scenario.actors)
        self._tick = 0
        self._frozen: dict[str, str] | None = None

    def __enter__(self) -> Self:
        if libsumo.isLoaded():
            raise WorldError("SUMO holds one simulation a process, and one is open already")
        try:
            libsumo.start(self._command())
            add_types()
            make_slippery(self._grip)
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
            *friction_options(self._grip),
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

    def start(self, egos: Mapping[str, EgoState], scripted: Actors) -> WorldState:
        """Places the egos and makes the first step, so that vehicles departing at 0 s are there in frame 0."""
        return self.advance(egos, scripted, ())

    def advance(self, egos: Mapping[str, EgoState], scripted: Actors, struck: Collection[str]) -> WorldState:
        """The only deed: places egos and ghosts, holds struck vehicles, steps SUMO, and reads what it drives.

        Egos that are no longer named leave the world. Raises WorldError where SUMO fails or teleports a vehicle.
        """
        try:
            scripted = self._scripted.noticed(scripted) if len(scripted) else scripted
            if self._replay.releases:
                for vehicle, berth in self._replay.released(self._tick, self._movers(egos), self._last):
                    self._traffic.take(vehicle, berth)
            replayed = self._replay.actors(self._tick)
            if self._traffic.drives:  # otherwise nobody is there to see them
                self._place_egos(egos)
                self._place_ghosts(egos, (scripted, replayed))
            self._traffic.hold(struck, self._tick)
            self._traffic.prepare(
                self._tick, lambda: self._everybody(egos, scripted), lambda: self._unplanned(egos, scripted)
            )
            libsumo.simulationStep()
            self._tick += 1
            if libsumo.simulation.getStartingTeleportNumber():
                raise WorldError(
                    f"SUMO teleported {libsumo.simulation.getStartingTeleportIDList()} at step {self._tick}"
                )
            driven = self._actors()
            if offsets := self._traffic.offsets:
                shifted(driven, offsets)
            self._last = driven.merge(replayed)
            return WorldState(self._last, self._signals())
        except libsumo.TraCIException as error:
            raise WorldError(f"SUMO failed at step {self._tick}: {error}") from error

    def _place_egos(self, egos: Mapping[str, EgoState]) -> None:
        """A double that SUMO lost from the road is replaced: put back on it, it may crash SUMO (docs/decisions/015)."""
        lost = [ego for ego in self._egos if ego not in egos or not self._lane_of(EGO + ego)]
        for gone in lost:
            libsumo.vehicle.remove(EGO + gone)
        for ego_id in [ego for ego in egos if ego in lost or ego not in self._egos]:
            add_remote(EGO + ego_id, EGO, self._sizes[ego_id], self._edge_at(egos[ego_id]), self._roads)
        self._egos = tuple(egos)
        for ego_id, ego in egos.items():
            x, y = front_bumper(ego.x, ego.y, ego.yaw, self._sizes[ego_id][0])
            place(EGO + ego_id, x, y, ego.yaw, ego.speed)

    def _everybody(self, egos: Mapping[str, EgoState], scripted: Actors) -> Actors:
        """CAVs and scripted road users as they are placed for this step, the rest as it was after the last."""
        cavs = Actors.from_egos(egos, self._sizes)
        return replace(cavs, ids=tuple(EGO + name for name in cavs.ids)).concat(scripted, self._last)

    def _unplanned(self, egos: Mapping[str, EgoState], scripted: Actors) -> list[Mover]:
        """Whatever rolls and keeps to no schedule: CAVs, scripted vehicles and cyclists, traffic that is late."""
        on_time = self._traffic.on_time
        rolling = ((scripted, i) for i in np.flatnonzero(np.isin(scripted.kind, ROLLING) & (scripted.speed > 0)))
        late = ((self._last, i) for i, name in enumerate(self._last.ids) if name not in on_time)
        return [*self._movers(egos), *(mover_of(some, int(i)) for some, i in chain(rolling, late))]

    def _edge_at(self, ego: EgoState) -> str:
        return self._roads.driving[int(self._roads.nearest(np.array([[ego.x, ego.y]])).lane[0])].edge

    def _movers(self, egos: Mapping[str, EgoState]) -> list[Mover]:
        return [Mover(one.x, one.y, one.yaw, one.speed, *self._sizes[name]) for name, one in egos.items()]

    def _place_ghosts(self, egos: Mapping[str, EgoState], others: Sequence[Actors]) -> None:
        if self._mirror.looks(self._tick):
            bodies = [body for some in others for body in bodies_of(some)]
            self._mirror.look([*self._ego_bodies(egos), *bodies])
            return
        self._mirror.follow({EGO + name for name in egos}.union(*(names_of(some) for some in others if len(some))))

    def _ego_bodies(self, egos: Mapping[str, EgoState]) -> list[Body]:
        return [
            Body(EGO + name, one.x, one.y, one.yaw, one.speed, *self._sizes[name], self._lane_of(EGO + name))
            for name, one in egos.items()
        ]

    def _lane_of(self, double: str) -> str:
        return libsumo.vehicle.getLaneID(double) if self._tick else ""

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
        """Who of the vehicles in SUMO is background (ids without a colon), with sizes; poses come on every tick."""
        ids = tuple(sorted(i for i in present if ":" not in i))
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
