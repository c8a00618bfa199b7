"""ScenarioBuilder: a scenario in a few lines, with one sentence for each mistake."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import cast

from pydantic import ValidationError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.roads import RoadMap, Route
from mdrive_sumo.scenario.background import Background, BackgroundVehicle
from mdrive_sumo.scenario.checks import check_scenario
from mdrive_sumo.scenario.scenario import Ego, RoadsideUnit, Scenario, SignalRule, SpeedRule, describe_first_error
from mdrive_sumo.scenario.scripted_actor import Actor, Trigger
from mdrive_sumo.scenario.spawn_overlaps import find_spawn_overlaps
from mdrive_sumo.scenario.weather import WeatherName
from mdrive_sumo.worlds.authoring.road_users import (
    CYCLING_SPEED,
    WALKING_SPEED,
    Behaviour,
    RowSide,
    VehicleModel,
    build_prop,
    build_row,
    build_scripted_vehicle,
    build_traffic_vehicle,
    build_walker,
)
from mdrive_sumo.worlds.authoring.route_steps import Point, RouteSteps, build_route, check_lane
from mdrive_sumo.worlds.authoring.suite_folder import save_in_suite
from mdrive_sumo.worlds.placement.cavs import build_ego
from mdrive_sumo.worlds.traffic import TrafficDemand, draw_traffic, find_demand

BUCKET = "Own"
"""Bucket of scenarios that are written by hand."""


@dataclass(eq=False)
class ScenarioBuilder:
    """A scenario that grows: `add_...` its road users, then `build()` it, or `save(folder)` it into a suite.

    A route is a text such as "west_in_2 -45 > west_in_1 -40 > south_out_1 20": lane and arc length [m] of start and
    goal, numbers below zero from the lane's end; lanes between them lead the way, and a number there says where the
    change into that lane begins. Points (x, y) [m] may stand in place of lanes: ["12,-40", "60,3"] or
    [(12, -40), (60, 3)]. Every `add_...` returns the id of what it has added, and raises InputError.
    """

    id: str
    roads: RoadMap
    category: str = "own"
    description: str = ""
    signals: SignalRule = "program"
    speeds: SpeedRule = "road"
    """Desired speed of CAVs: the limits of the road, or the protocol's 8 m/s."""
    weather: WeatherName = "default"
    _egos: list[Ego] = field(default_factory=list[Ego], init=False, repr=False)
    _vehicles: list[BackgroundVehicle] = field(default_factory=list[BackgroundVehicle], init=False, repr=False)
    _actors: list[Actor] = field(default_factory=list[Actor], init=False, repr=False)
    _rsus: list[RoadsideUnit] = field(default_factory=list[RoadsideUnit], init=False, repr=False)
    _traffic: tuple[TrafficDemand, int] | None = field(default=None, init=False, repr=False)
    _names: set[str] = field(default_factory=set[str], init=False, repr=False)

    @property
    def egos(self) -> tuple[Ego, ...]:
        """The CAVs that were added."""
        return tuple(self._egos)

    def clear(self) -> None:
        """Remove all road users."""
        for added in (self._egos, self._vehicles, self._actors, self._rsus, self._names):
            added.clear()
        self._traffic = None

    def add_cav(
        self, route: RouteSteps, id: str = "", *, start_speed: float = 0.0, time_limit_s: float | None = None
    ) -> str:
        """Add a CAV, which the agent under test drives. start_speed [m/s]; time_limit_s: None for the protocol's."""
        name = self._name("cav", id)
        with _Sentence(self.id, name):
            ego = build_ego(name, build_route(self.roads, route), start_speed)
            self._egos.append(Ego.model_validate({**dict(ego), "time_limit_s": time_limit_s}))
        return self._keep(name)

    def add_route(self, route: Route, id: str = "") -> str:
        """Add a CAV on a dense route of `roads.routing`."""
        name = self._name("cav", id)
        with _Sentence(self.id, name):
            self._egos.append(build_ego(name, route))
        return self._keep(name)

    def add_actor(self, actor: Actor) -> str:
        """Add a scripted road user that was built elsewhere, under its own id."""
        self._actors.append(actor)
        return self._keep(self._name(actor.kind, actor.id))

    def add_vehicle(
        self, route: RouteSteps, id: str = "", *, model: VehicleModel = "car", speed: float = 0.0, depart_s: float = 0.0
    ) -> str:
        """Add a vehicle of SUMO's traffic, which keeps distances and gives way. speed [m/s]: at its departure."""
        name = self._name(model, id)
        with _Sentence(self.id, name):
            found = build_route(self.roads, route)
            self._vehicles.append(build_traffic_vehicle(name, self.roads, found, model, speed, depart_s))
        return self._keep(name)

    def add_scripted_vehicle(
        self,
        route: RouteSteps,
        id: str = "",
        *,
        speed: float,
        model: VehicleModel = "car",
        when: Trigger | None = None,
        then: Behaviour = "start",
    ) -> str:
        """Add a vehicle that drives its lanes at `speed` [m/s]. `when` it is triggered, it starts, brakes hard or
        changes its lane."""
        name = self._name(model, id)
        with _Sentence(self.id, name):
            found = build_route(self.roads, route)
            self._actors.append(build_scripted_vehicle(name, found, model, speed, when, then))
        return self._keep(name)

    def add_pedestrian(
        self, *way: Point, id: str = "", speed: float = WALKING_SPEED, when: Trigger | None = None
    ) -> str:
        """Add a person who walks through points (x, y) [m], at once or `when` triggered."""
        return self._add_walker("pedestrian", "adult", way, id, speed, when)

    def add_cyclist(self, *way: Point, id: str = "", speed: float = CYCLING_SPEED, when: Trigger | None = None) -> str:
        """Add a cyclist who rides through points (x, y) [m], at once or `when` triggered."""
        return self._add_walker("cyclist", "bicycle", way, id, speed, when)

    def _add_walker(
        self, kind: str, model: str, way: Sequence[Point], id: str, speed: float, when: Trigger | None
    ) -> str:
        name = self._name(kind, id)
        with _Sentence(self.id, name):
            self._actors.append(build_walker(name, model, way, speed, when))
        return self._keep(name)

    def add_parked_row(
        self, lane: str, begin: float, end: float, id: str = "", *, model: VehicleModel = "car", side: RowSide = "right"
    ) -> str:
        """Add parked vehicles beside a lane, from arc length `begin` to `end` [m]; below zero from the lane's end."""
        name = self._name("parked", id)
        with _Sentence(self.id, name):
            check_lane(self.roads, lane)
            beside = self.roads.lanes[lane]
            first, last = (s + beside.centre.length if s < 0 else s for s in (begin, end))
            self._actors.extend(build_row(name, beside, (first, last), model, side))
        return self._keep(name)

    def add_prop(self, model: str, at: Point, id: str = "", *, yaw: float | None = None) -> str:
        """Add a static object of `scenario.props` at a point (x, y) [m]. yaw [rad]: None for that of the lane there."""
        name = self._name(model, id)
        with _Sentence(self.id, name):
            self._actors.append(build_prop(name, self.roads, model, at, yaw))
        return self._keep(name)

    def add_rsu(self, at: Point, id: str = "", *, range_m: float = 80.0) -> str:
        """Add a road-side unit at a point (x, y) [m] that sends what it detects within its range."""
        name = self._name("rsu", id)
        with _Sentence(self.id, name):
            self._rsus.append(RoadsideUnit(id=name, x=at[0], y=at[1], range_m=range_m))
        return self._keep(name)

    def add_traffic(self, demand: str = "town-quiet", seed: int = 0) -> None:
        """Add traffic of a named demand of `worlds.traffic.DEMANDS`, drawn around all that is there at the end."""
        with _Sentence(self.id, "traffic"):
            self._traffic = find_demand(demand), seed

    def build(self) -> Scenario:
        """Return the scenario. Raises InputError for one that does not fit its network, or with overlapping starts."""
        if not self._egos:
            raise InputError(f"scenario {self.id}: expected at least one CAV, found none; add_cav adds one")
        vehicles, actors = self._draw_traffic()
        with _Sentence(self.id, ""):
            scenario = Scenario(
                id=self.id,
                bucket=BUCKET,
                category=self.category,
                network=self.roads.name,
                description=self.description,
                signals=self.signals,
                speeds=self.speeds,
                egos=tuple(self._egos),
                background=Background(vehicles=vehicles),
                actors=actors,
                weather=self.weather,
                rsus=tuple(self._rsus),
            )
        check_scenario(scenario, self.roads)
        for overlap in find_spawn_overlaps(scenario, self.roads):
            raise InputError(f"scenario {self.id}: {overlap}")
        return scenario

    def _draw_traffic(self) -> tuple[tuple[BackgroundVehicle, ...], tuple[Actor, ...]]:
        """Return SUMO's vehicles and the scripted road users, with the traffic that is drawn around them."""
        if self._traffic is None:
            return tuple(self._vehicles), tuple(self._actors)
        demand, seed = self._traffic
        drawn = draw_traffic(self.roads, self._egos, self._actors, demand, Random(f"{self.id}/{seed}"))
        return (*self._vehicles, *drawn.vehicles), drawn.actors

    def save(self, folder: str | Path) -> Path:
        """Build the scenario and write it, with its network, into a suite folder, new or not; return the folder."""
        return save_in_suite(self.build(), self.roads, Path(folder))

    def _name(self, kind: str, wanted: str) -> str:
        """Return the id of a new road user. Raises InputError for one that is taken."""
        if not isinstance(cast(object, wanted), str):
            raise InputError(f"scenario {self.id}: id: expected a text, found {wanted!r:.40}")
        if wanted in self._names:
            raise InputError(
                f"scenario {self.id}: id: expected one of its own for every road user, found {wanted!r} twice"
            )
        numbers = (f"{kind}{number}" for number in range(len(self._names) + 1))
        return wanted or next(name for name in numbers if name not in self._names)

    def _keep(self, name: str) -> str:
        self._names.add(name)
        return name


class _Sentence:
    """Begins the sentence of an error with the scenario and the road user, and makes one of a validation error."""

    def __init__(self, scenario: str, road_user: str) -> None:
        self._where = f"scenario {scenario}: " + (f"{road_user}: " if road_user else "")

    def __enter__(self) -> None:
        return None

    def __exit__(self, _type: object, error: BaseException | None, _trace: object) -> None:
        if isinstance(error, ValidationError):
            raise InputError(self._where + describe_first_error(error)) from None
        if isinstance(error, InputError):
            raise InputError(self._where + str(error)) from None
