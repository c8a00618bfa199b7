"""SumoWorld: SUMO in process. Every SUMO quirk lives here, and nothing else imports libsumo.

SUMO's pose is the front bumper and degrees clockwise from north; ours is the box centre and radians
counter-clockwise from +x. Ghosts, egos' doubles and SUMO's own ids stay behind this door.
"""

# pyright: basic
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain, repeat
from types import TracebackType
from typing import Any, Self

import libsumo
import numpy as np
import shapely

from mdrive_sumo.errors import InputError, WorldError
from mdrive_sumo.geometry import Float, box_corners
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.spec import Scenario
from mdrive_sumo.state import DT, TICKS_PER_SECOND, Actors, EgoState, Kind, no_actors

_position, _angle, _speed = (
    getattr(libsumo.libsumo._libsumo, f"vehicle_get{what}") for what in ("Position", "Angle", "Speed")
)
"""libsumo's own functions below its Python wrappers, which take as long again; called for every vehicle and tick."""
EGO, GHOST = "ego:", "ghost:"
HELD_TICKS = 2 * TICKS_PER_SECOND
"""How long a struck background vehicle stands (design/architecture, decisions)."""
CORRIDOR_M = 1.8
"""Width of the strip that a background vehicle sweeps on its lane: SUMO's default passenger car."""
MATCH_M = 5.0
"""How far [m] SUMO looks for a lane to put a placed vehicle on. Its default, 100 m, takes twice as long."""
GHOST_TICKS = 5
"""Which lanes an ego overlaps is found every 0.25 s; between, its ghosts move along. SUMO's drivers look less often."""
KEEP_ROUTE = 2
"""moveToXY: take x, y, angle as they are, on any lane and off the road too (sumo_pitfalls 1.1)."""


def yaws_from_sumo(angles_deg: Float) -> Float:
    """SUMO headings (N,) [deg, clockwise from north] -> yaws [rad, counter-clockwise from +x] in [-pi, pi)."""
    return np.radians((270.0 - angles_deg) % 360.0 - 180.0)


def angle_to_sumo(yaw: float) -> float:
    """Yaw [rad] -> SUMO heading [deg] in [0, 360)."""
    return math.degrees(math.pi / 2 - yaw) % 360.0


def front_bumper(x: float, y: float, yaw: float, length: float) -> tuple[float, float]:
    """Box centre -> the front bumper point that SUMO calls the position."""
    return x + math.cos(yaw) * length / 2, y + math.sin(yaw) * length / 2


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What SUMO drives: background vehicles, and the states of traffic lights by id."""

    actors: Actors
    signals: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Ghost:
    """A stand-in on a lane that an ego overlaps without being on it, so that SUMO's traffic sees it there."""

    ego: str
    lane: Lane
    front_s: float
    """Arc length [m] on the lane of the foremost point of the overlap."""
    length: float
    speed: float

    def moved(self) -> "Ghost":
        """The ghost one tick later, if its ego goes on as it does."""
        return Ghost(self.ego, self.lane, self.front_s + self.speed * DT, self.length, self.speed)


class SumoWorld:
    """One simulation; a context manager. SUMO holds one simulation a process, so a second one is refused."""

    def __init__(self, scenario: Scenario, roads: RoadMap, sizes: Mapping[str, tuple[float, float]], seed: int) -> None:
        """`sizes`: (length, width) [m] of every ego. `seed` drives all of SUMO's own randomness."""
        self._scenario, self._roads, self._sizes, self._seed = scenario, roads, sizes, seed
        self._known: dict[str, tuple[float, float]] = {}
        self._present: Sequence[str] = ()
        self._cast = no_actors()
        self._held: dict[str, int] = {}
        self._egos: tuple[str, ...] = ()
        self._ghosts: dict[str, Ghost] = {}
        self._tick = 0
        self._frozen: dict[str, str] | None = None

    def __enter__(self) -> Self:
        if libsumo.isLoaded():
            raise WorldError("SUMO holds one simulation a process, and one is open already")
        try:
            libsumo.start(self._command())
            self._add_types()
            self._freeze_lights()
            self._add_background()
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

    @staticmethod
    def _add_types() -> None:
        for name in (EGO, GHOST):
            libsumo.vehicletype.copy("DEFAULT_VEHTYPE", name)
            libsumo.vehicletype.setMinGap(name, 2.5)

    def _freeze_lights(self) -> None:
        """`frozen-green`: every link shows g. With G background cars would take each other's right of way."""
        if self._scenario.signals != "frozen-green":
            return
        self._frozen = {}
        for light in sorted(libsumo.trafficlight.getIDList()):
            state = "g" * len(libsumo.trafficlight.getRedYellowGreenState(light))
            libsumo.trafficlight.setRedYellowGreenState(light, state)
            self._frozen[light] = state

    def _add_background(self) -> None:
        for vehicle in self._scenario.background.vehicles:
            libsumo.route.add(vehicle.id, list(vehicle.edges))
            libsumo.vehicle.add(
                vehicle.id, vehicle.id, depart=f"{vehicle.depart_s:.3f}", departLane=str(vehicle.depart_lane),
                departPos=str(vehicle.depart_pos_m), departSpeed=str(vehicle.depart_speed),
            )  # fmt: skip

    def start(self, egos: Mapping[str, EgoState]) -> Surroundings:
        """Places the egos and makes the first step, so that vehicles departing at 0 s are there in frame 0."""
        return self.advance(egos, ())

    def advance(self, egos: Mapping[str, EgoState], struck: Collection[str]) -> Surroundings:
        """The only deed: places egos and ghosts, holds struck vehicles, steps SUMO, and reads what it drives.

        Egos that are no longer named leave the world. Raises WorldError where SUMO fails or teleports a vehicle.
        """
        try:
            self._place_egos(egos)
            self._place_ghosts(egos)
            self._hold(struck)
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
            self._add_remote(EGO + ego_id, EGO, *self._sizes[ego_id], self._edge_at(egos[ego_id]))
        self._egos = tuple(egos)
        for ego_id, ego in egos.items():
            x, y = front_bumper(ego.x, ego.y, ego.yaw, self._sizes[ego_id][0])
            _place(EGO + ego_id, x, y, ego.yaw, ego.speed)

    def _edge_at(self, ego: EgoState) -> str:
        return self._roads.driving[int(self._roads.nearest(np.array([[ego.x, ego.y]])).lane[0])].edge

    def _add_remote(self, name: str, kind: str, length: float, width: float, edge: str) -> None:
        """A vehicle that we place on every step. Its route is a dummy: with keepRoute=2 SUMO rewrites it anyway."""
        road = edge if not edge.startswith(":") else self._any_road
        if road not in libsumo.route.getIDList():
            libsumo.route.add(road, [road])
        libsumo.vehicle.add(name, road, typeID=kind)
        libsumo.vehicle.setLength(name, length)
        libsumo.vehicle.setWidth(name, width)
        libsumo.vehicle.setSpeedMode(name, 0)
        libsumo.vehicle.setLaneChangeMode(name, 0)

    @property
    def _any_road(self) -> str:
        return next(lane.edge for lane in self._roads.driving if not lane.junction)

    def _place_ghosts(self, egos: Mapping[str, EgoState]) -> None:
        if not self._known and not self._scenario.background.vehicles:
            return  # nobody is there to see them
        if self._tick % GHOST_TICKS == 0:
            wanted = dict(ghost for ego_id, ego in egos.items() for ghost in self._ghosts_of(ego_id, ego).items())
        else:
            wanted = {name: ghost.moved() for name, ghost in self._ghosts.items() if ghost.ego in egos}
        for name in [name for name in self._ghosts if name not in wanted]:
            libsumo.vehicle.remove(name)
        for name, ghost in wanted.items():
            if name not in self._ghosts:
                self._add_remote(name, GHOST, ghost.length, CORRIDOR_M, ghost.lane.edge)
            elif ghost.length != self._ghosts[name].length:
                libsumo.vehicle.setLength(name, ghost.length)
            x, y = ghost.lane.centre.at(ghost.front_s)
            hint = (ghost.lane.edge, ghost.lane.index)
            _place(name, x, y, ghost.lane.centre.yaw_at(ghost.front_s), ghost.speed, hint)
        self._ghosts = wanted

    def _ghosts_of(self, ego_id: str, ego: EgoState) -> dict[str, Ghost]:
        """A ghost for every lane whose vehicle corridor the ego's box overlaps, but the one where SUMO sees the ego."""
        box = shapely.polygons(box_corners(ego.x, ego.y, ego.yaw, *self._sizes[ego_id]))
        seen_on = libsumo.vehicle.getLaneID(EGO + ego_id) if self._tick else ""
        strips = _corridors(self._roads)
        found: dict[str, Ghost] = {}
        for i in sorted(strips.tree.query(box, predicate="intersects")):
            lane = self._roads.driving[i]
            if lane.id == seen_on:
                continue
            corners = shapely.get_coordinates(shapely.intersection(box, strips.tree.geometries[i]))
            stations = shapely.line_locate_point(strips.lines[i], shapely.points(corners))
            front, along = float(stations.max()), ego.speed * math.cos(ego.yaw - lane.centre.yaw_at(stations.max()))
            length = max(front - float(stations.min()), 0.5)
            found[f"{GHOST}{ego_id}:{lane.id}"] = Ghost(ego_id, lane, front, length, max(along, 0.0))
        return found

    def _hold(self, struck: Collection[str]) -> None:
        """Struck background vehicles stand for a while: a surrogate, SUMO knows no impact."""
        for vehicle in struck:
            if vehicle in self._known:
                self._held[vehicle] = self._tick + HELD_TICKS
        if not self._held:
            return
        present = set(libsumo.vehicle.getIDList())
        for vehicle, until in sorted(self._held.items()):
            if vehicle not in present or self._tick >= until:
                del self._held[vehicle]
                if vehicle in present:
                    libsumo.vehicle.setSpeed(vehicle, -1)
            else:
                libsumo.vehicle.setPreviousSpeed(vehicle, 0.0)
                libsumo.vehicle.setSpeed(vehicle, 0.0)

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


def _place(name: str, x: float, y: float, yaw: float, speed: float, hint: tuple[str, int] = ("", -1)) -> None:
    """Puts a vehicle there for the coming step. Without setSpeed SUMO reports a phantom speed (sumo_pitfalls 1.6)."""
    libsumo.vehicle.moveToXY(name, *hint, x, y, angle_to_sumo(yaw), KEEP_ROUTE, MATCH_M)
    libsumo.vehicle.setSpeed(name, max(speed, 0.0))


@dataclass(frozen=True, slots=True)
class _Corridors:
    """Centre lines (L,) and the strips that background vehicles sweep, in the order of `RoadMap.driving`."""

    lines: Any
    tree: shapely.STRtree


@lru_cache(maxsize=8)
def _corridors(roads: RoadMap) -> _Corridors:
    lines = np.array([shapely.LineString(lane.centre.xy) for lane in roads.driving], dtype=object)
    return _Corridors(lines, shapely.STRtree(shapely.buffer(lines, CORRIDOR_M / 2, cap_style="flat")))
