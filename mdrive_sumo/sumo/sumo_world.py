"""SUMO in process. Ghosts, placed vehicles and SUMO's own ids are internal to this package."""

# pyright: basic
# Because libsumo has no type information.
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from itertools import chain, repeat
from types import TracebackType
from typing import Self

import libsumo
import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.errors import InputError, WorldError
from mdrive_sumo.core.frozen import build_frozen
from mdrive_sumo.core.state import DT, Actors, EgoState, Kind, WorldState
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.sumo.background_traffic import BackgroundTraffic
from mdrive_sumo.sumo.conflict import MovingBox, build_moving_box
from mdrive_sumo.sumo.ghost_manager import GhostManager, MirroredActors, build_source_boxes, build_source_ids
from mdrive_sumo.sumo.ghost_placement import SourceBox
from mdrive_sumo.sumo.lane_change import apply_offsets
from mdrive_sumo.sumo.log_replay import LogReplay
from mdrive_sumo.sumo.placed_vehicles import EGO, add_placed_types, add_placed_vehicle, place_vehicle
from mdrive_sumo.sumo.sumo_frames import compute_front_bumper, place_actors

# pyright: basic
# Because libsumo has no type information.


_raw = libsumo.libsumo._libsumo
_position, _angle, _speed = _raw.vehicle_getPosition, _raw.vehicle_getAngle, _raw.vehicle_getSpeed
_light_state = _raw.trafficlight_getRedYellowGreenState
"""libsumo's functions without the Python wrappers, which double their time; called for every vehicle and tick."""
ROLLING = (Kind.VEHICLE, Kind.CYCLIST)
KERB_SHIFT_M = 0.55
"""[m] From the middle of a lane for cars to the line on which cyclists ride: as far to the side as they are within the
strip of 1.8 m in which SUMO's drivers see ghosts (`ghost_placement.CORRIDOR_M`)."""


class SumoWorld:
    """One SUMO simulation, as a context manager. A process can hold one only; a second one raises WorldError."""

    def __init__(
        self,
        scenario: Scenario,
        roads: RoadMap,
        dimensions: Mapping[str, tuple[float, float]],
        seed: int,
        grip: float = 1.0,
    ) -> None:
        """`dimensions`: (length, width) [m] of every ego. `seed`: for all of SUMO's randomness.

        `grip`: share in (0, 1] of a dry road's friction.
        """
        self._scenario, self._roads, self._dimensions, self._seed = scenario, roads, dimensions, seed
        self._grip = grip
        self._dimensions_by_vehicle: dict[str, tuple[float, float]] = {}
        self._present: Sequence[str] = ()
        self._template = self._last = Actors.empty()
        self._traffic = BackgroundTraffic(scenario.background, roads)
        self._placed_egos: tuple[str, ...] = ()
        self._replay = LogReplay(scenario.background, roads)
        self._ghosts = GhostManager(roads)
        self._mirrored_actors = MirroredActors(scenario.actors)
        self._tick = 0
        self._lights: tuple[str, ...] = ()
        self._frozen_signals: dict[str, str] | None = None
        vehicles = scenario.background.vehicles
        self._cyclists = frozenset(one.id for one in vehicles if one.kind == "cyclist")
        self._lane_offsets = {one.id: one.lane_offset_m for one in vehicles if one.lane_offset_m}
        self._lane_offsets |= dict.fromkeys(self._cyclists, -KERB_SHIFT_M)

    def __enter__(self) -> Self:
        if libsumo.isLoaded():
            raise WorldError("SUMO holds one simulation a process, and one is open already")
        try:
            libsumo.start(self._command())
            add_placed_types()
            make_slippery(self._grip)
            self._freeze_lights()
            self._traffic.add_vehicles()
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
        """Return SUMO's command line (sumo_pitfalls 2.1, 6.1, 11): no teleports, no collision actions."""
        action_step = str(self._scenario.background.action_step_s)
        return [
            "sumo", "--net-file", str(self._roads.net_file), "--seed", str(self._seed), "--step-length", str(DT),
            "--default.action-step-length", action_step, "--lanechange.duration", "2",
            "--time-to-teleport", "-1", "--time-to-teleport.disconnected", "-1", "--time-to-teleport.ride", "-1",
            "--collision.action", "none", "--intermodal-collision.action", "none", "--collision.check-junctions",
            "--no-step-log", "--no-warnings", "--duration-log.disable",
            *build_friction_options(self._grip),
        ]  # fmt: skip

    def _freeze_lights(self) -> None:
        """List the lights; for `frozen-green` set every link to g. With G, background cars would not give way."""
        self._lights = tuple(sorted(libsumo.trafficlight.getIDList()))
        if self._scenario.signals != "frozen-green":
            return
        self._frozen_signals = {}
        for light in self._lights:
            state = "g" * len(libsumo.trafficlight.getRedYellowGreenState(light))
            libsumo.trafficlight.setRedYellowGreenState(light, state)
            self._frozen_signals[light] = state

    def start(self, egos: Mapping[str, EgoState], scripted: Actors) -> WorldState:
        """Place the egos and make the first step, so that vehicles departing at 0 s are in frame 0."""
        return self.advance(egos, scripted, ())

    def advance(self, egos: Mapping[str, EgoState], scripted: Actors, struck: Collection[str]) -> WorldState:
        """Place egos and ghosts, hold struck vehicles, step SUMO, and return what it drives.

        Egos that are no longer named leave the world. Raises WorldError if SUMO fails or teleports a vehicle.
        """
        try:
            scripted = self._mirrored_actors.select(scripted) if len(scripted) else scripted
            if self._replay.can_release:
                for vehicle, point in self._replay.release_disturbed(
                    self._tick, self._build_moving_boxes(egos), self._last
                ):
                    self._traffic.take_over(vehicle, point)
            replayed = self._replay.actors(self._tick)
            if self._traffic.has_vehicles:  # otherwise no vehicle could react to them
                self._place_egos(egos)
                self._place_ghosts(egos, (scripted, replayed))
            self._traffic.hold(struck, self._tick)
            self._traffic.prepare(
                self._tick,
                lambda: self._collect_road_users(egos, scripted),
                lambda: self._collect_unscheduled(egos, scripted),
            )
            libsumo.simulationStep()
            self._tick += 1
            if libsumo.simulation.getStartingTeleportNumber():
                raise WorldError(
                    f"SUMO teleported {libsumo.simulation.getStartingTeleportIDList()} at step {self._tick}"
                )
            driven = self._read_actors()
            if offsets := self._traffic.lane_change_offsets:
                apply_offsets(driven, offsets)
            if self._lane_offsets:
                self._shift_sideways(driven)
            self._traffic.show_parked(driven)
            self._last = driven.merge(replayed)
            return build_frozen(WorldState, self._last, self._read_signals())
        except libsumo.TraCIException as error:
            raise WorldError(f"SUMO failed at step {self._tick}: {error}") from error

    def _place_egos(self, egos: Mapping[str, EgoState]) -> None:
        """Place the vehicles of the egos. Replace one that SUMO lost: moving it back may crash SUMO (decision 015)."""
        lost = [ego for ego in self._placed_egos if ego not in egos or not self._find_lane(EGO + ego)]
        for gone in lost:
            libsumo.vehicle.remove(EGO + gone)
        for ego_id in [ego for ego in egos if ego in lost or ego not in self._placed_egos]:
            add_placed_vehicle(EGO + ego_id, EGO, self._dimensions[ego_id], self._find_edge(egos[ego_id]), self._roads)
        self._placed_egos = tuple(egos)
        for ego_id, ego in egos.items():
            x, y = compute_front_bumper(ego.x, ego.y, ego.yaw, self._dimensions[ego_id][0])
            place_vehicle(EGO + ego_id, x, y, ego.yaw, ego.speed)

    def _collect_road_users(self, egos: Mapping[str, EgoState], scripted: Actors) -> Actors:
        """Return CAVs and scripted actors as placed for this step, and all others as read after the last step."""
        cavs = Actors.from_egos(egos, self._dimensions)
        return replace(cavs, ids=tuple(EGO + name for name in cavs.ids)).concat(scripted, self._last)

    def _collect_unscheduled(self, egos: Mapping[str, EgoState], scripted: Actors) -> list[MovingBox]:
        """Return the moving boxes that follow no schedule: CAVs, scripted vehicles and cyclists, late vehicles."""
        on_schedule = self._traffic.on_schedule_ids
        rolling = ((scripted, i) for i in np.flatnonzero(np.isin(scripted.kind, ROLLING) & (scripted.speed > 0)))
        late = ((self._last, i) for i, name in enumerate(self._last.ids) if name not in on_schedule)
        return [*self._build_moving_boxes(egos), *(build_moving_box(some, int(i)) for some, i in chain(rolling, late))]

    def _find_edge(self, ego: EgoState) -> str:
        return self._roads.driving[int(self._roads.find_nearest_lanes(np.array([[ego.x, ego.y]])).lane[0])].edge

    def _build_moving_boxes(self, egos: Mapping[str, EgoState]) -> list[MovingBox]:
        return [MovingBox(one.x, one.y, one.yaw, one.speed, *self._dimensions[name]) for name, one in egos.items()]

    def _place_ghosts(self, egos: Mapping[str, EgoState], others: Sequence[Actors]) -> None:
        if self._ghosts.is_search_due(self._tick):
            sources = [body for some in others for body in build_source_boxes(some)]
            self._ghosts.search([*self._build_source_boxes(egos), *sources])
            return
        if self._ghosts.has_ghosts:
            scripted = (build_source_ids(some) for some in others if len(some))
            self._ghosts.advance({EGO + name for name in egos}.union(*scripted))

    def _build_source_boxes(self, egos: Mapping[str, EgoState]) -> list[SourceBox]:
        return [
            SourceBox(
                EGO + name, one.x, one.y, one.yaw, one.speed, *self._dimensions[name], self._find_lane(EGO + name)
            )
            for name, one in egos.items()
        ]

    def _find_lane(self, placed_id: str) -> str:
        return libsumo.vehicle.getLaneID(placed_id) if self._tick else ""

    def _read_actors(self) -> Actors:
        """Read the background vehicles: one pass of direct getters (sumo_pitfalls 9.1)."""
        present = libsumo.vehicle.getIDList()
        if present != self._present:
            self._present, self._template = present, self._build_template(present)
        ids = self._template.ids
        if not ids:
            return self._template
        fronts = list(map(_position, ids, repeat(False)))
        return place_actors(self._template, fronts, list(map(_angle, ids)), list(map(_speed, ids)))

    def _shift_sideways(self, driven: Actors) -> None:
        """Put vehicles on their own line in the lane, cyclists to the kerb side, in place: SUMO has all in the middle.

        On cycle lanes cyclists stay in the middle.
        """
        for name in self._lane_offsets.keys() & set(driven.ids):
            if name in self._cyclists and libsumo.vehicle.getLaneID(name) not in self._roads.lanes:
                continue
            i, offset = driven.ids.index(name), self._lane_offsets[name]
            cos, sin = portable.cos_sin(driven.yaw[i])
            driven.x[i] -= sin * offset
            driven.y[i] += cos * offset

    def _build_template(self, present: Sequence[str]) -> Actors:
        """Return the background vehicles in SUMO (ids without a colon) with dimensions, without poses."""
        ids = tuple(sorted(i for i in present if ":" not in i))
        for new in ids:
            if new not in self._dimensions_by_vehicle:
                self._dimensions_by_vehicle[new] = (libsumo.vehicle.getLength(new), libsumo.vehicle.getWidth(new))
        size = np.array([self._dimensions_by_vehicle[i] for i in ids]).reshape(-1, 2)
        zeros = np.zeros(len(ids))
        kinds = [Kind.CYCLIST if name in self._cyclists else Kind.VEHICLE for name in ids]
        return Actors(ids, np.array(kinds, dtype=np.uint8), zeros, zeros, zeros, zeros, size[:, 0], size[:, 1])

    def _read_signals(self) -> Mapping[str, str]:
        if self._frozen_signals is not None:
            return self._frozen_signals
        return dict(zip(self._lights, map(_light_state, self._lights), strict=True))


def build_friction_options(grip: float) -> list[str]:
    """Return SUMO's options: on a slippery road every vehicle has the device, without measurement error."""
    if grip == 1.0:
        return []  # the device draws random numbers, so a dry run must not have it
    return ["--device.friction.probability", "1", "--device.friction.stdDev", "0"]


def make_slippery(grip: float) -> None:
    """Set the friction of all roads to a share of a dry road's. Call after the start of SUMO."""
    if grip < 1.0:
        for edge in libsumo.edge.getIDList():
            libsumo.edge.setFriction(edge, grip)
