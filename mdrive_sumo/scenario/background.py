"""SUMO's traffic in a scenario file: vehicles with routes and, where they come from a log, with its schedule."""

from itertools import pairwise
from typing import Literal

from pydantic import Field, model_validator

from mdrive_sumo.scenario.scenario_part import Coordinate, Identifier, ScenarioPart, Seconds, Speed

BackgroundMode = Literal["reactive", "replay", "hybrid"]


def _is_unset(value: float | None) -> bool:
    """Return whether an optional field has its default: then it is left out of files and checksums."""
    return value is None


class CarFollowing(ScenarioPart):
    """Car-following parameters; the defaults are SUMO's for passenger cars (Krauss model)."""

    tau_s: float = Field(default=1.0, gt=0, le=10)
    """Time headway [s]."""
    min_gap_m: float = Field(default=2.5, ge=0, le=20)
    accel: float = Field(default=2.6, gt=0, le=20)
    decel: float = Field(default=4.5, gt=0, le=20)
    """[m/s2]"""
    sigma: float = Field(default=0.5, ge=0, le=1)
    """Driver imperfection."""
    max_speed: float | None = Field(default=None, gt=0, le=60, exclude_if=_is_unset)
    """[m/s] Of a truck or tractor; None: only the road's limit counts."""


class Schedule(ScenarioPart):
    """Desired progress of a logged vehicle along its route; car following and yielding have priority."""

    progress: tuple[tuple[Seconds, float], ...] = Field(min_length=2)
    """Time since the start of the scenario [s], distance of the front bumper along the route [m] from where it
    departed; both increasing, distances not strictly."""
    lanes: tuple[tuple[float, int], ...] = ()
    """Lane changes: from this distance [m] on it should be on that lane (index) of its edge."""
    leaves: bool = True
    """Whether it leaves the simulation at the end of its schedule, as in the log; else it drives on."""

    @model_validator(mode="after")
    def _check_order(self) -> "Schedule":
        for (t0, s0), (t1, s1) in pairwise(self.progress):
            if t1 <= t0 or s1 < s0:
                raise ValueError(f"schedule: expected times and distances that grow, found {t1, s1} after {t0, s0}")
        return self


def _is_empty(value: tuple[object, ...]) -> bool:
    """Return whether an optional list is empty: then it is left out of files and checksums."""
    return not value


def _is_vehicle(value: str) -> bool:
    """Return whether a kind is the default one, which is left out of files and checksums."""
    return value == "vehicle"


def _is_zero(value: float) -> bool:
    """Return whether a number has its default 0, which is left out of files and checksums."""
    return value == 0.0


def _is_false(value: bool) -> bool:
    """Return whether a flag has its default, which is left out of files and checksums."""
    return not value


class VehicleStop(ScenarioPart):
    """A stop in the lane on the way: of a bus, or of a van that delivers. Traffic behind waits or passes."""

    edge: str
    """One of the edges of the vehicle's route."""
    lane: int = Field(ge=0)
    """SUMO index of the lane."""
    pos_m: float = Field(gt=0)
    """Where the front bumper stops, along the lane."""
    duration_s: Seconds
    """How long it stands."""


class ParkedStart(ScenarioPart):
    """A vehicle that is parked beside its lane at the start and pulls out when there is a gap in the traffic."""

    offset_m: float = Field(ge=-10, le=10)
    """Of the centre of its box from that of the lane, positive to the left."""
    leaves_s: Seconds
    """Time since the start from which it waits for a gap."""


class BackgroundVehicle(ScenarioPart):
    """A vehicle driven by SUMO along `edges`."""

    id: Identifier
    depart_s: Seconds
    edges: tuple[str, ...] = Field(min_length=1)
    depart_lane: int = Field(default=0, ge=0)
    depart_pos_m: float = Field(default=0.0, ge=0)
    """Of the front bumper, along the first edge."""
    depart_speed: Speed = 0.0
    length: float = Field(default=5.0, gt=0, le=40)
    width: float = Field(default=1.8, gt=0, le=10)
    """[m]; SUMO's default passenger car."""
    driving: CarFollowing = CarFollowing()
    schedule: Schedule | None = None
    kind: Literal["vehicle", "cyclist"] = Field(default="vehicle", exclude_if=_is_vehicle)
    """A cyclist rides on cycle lanes where its edges have them, else at the kerb side of the lane for cars; e-scooters
    are cyclists."""
    lane_offset_m: float = Field(default=0.0, ge=-1, le=1, exclude_if=_is_zero)
    """Of its line from the middle of its lane, positive to the left: drivers do not keep to the middle, SUMO does."""
    keeps_lane: bool = Field(default=False, exclude_if=_is_false)
    """Whether it never changes lanes: then the lanes from its departure on must lead along its edges. SUMO moves a
    vehicle over within 2 s however near a standing one ahead is, so that their boxes overlap."""
    stops: tuple[VehicleStop, ...] = Field(default=(), exclude_if=_is_empty)
    """In the order of the route. A vehicle with a schedule has none."""
    parked: ParkedStart | None = Field(default=None, exclude_if=_is_unset)
    """If it is parked at the start: beside its departure position, at which it departs at 0 s."""
    log: tuple[tuple[Seconds, Coordinate, Coordinate, Coordinate], ...] = ()
    """Poses of the log for modes `replay` and `hybrid`: time since the start [s], x, y [m] of the box centre, yaw."""

    @model_validator(mode="after")
    def _check_stops(self) -> "BackgroundVehicle":
        if self.schedule is not None and (self.stops or self.parked is not None):
            raise ValueError(f"vehicle {self.id}: expected either a schedule or stops and a parked start, found both")
        for stop in self.stops:
            if stop.edge not in self.edges:
                raise ValueError(f"vehicle {self.id}: stops: expected edges of its route, found {stop.edge!r}")
        if self.parked is not None and (self.depart_s, self.depart_speed) != (0.0, 0.0):
            raise ValueError(f"vehicle {self.id}: parked: expected depart_s 0 and depart_speed 0, found another one")
        return self


class Background(ScenarioPart):
    """SUMO's traffic. Every vehicle is a passenger car of SUMO's default model unless its fields differ."""

    vehicles: tuple[BackgroundVehicle, ...] = ()
    action_step_s: float = Field(default=0.5, ge=0.05, le=1.0, multiple_of=0.05)
    """Reaction interval of background drivers (spec/sumo_pitfalls 6.1)."""
    mode: BackgroundMode = "reactive"
    """`reactive`: SUMO drives. `replay`: poses of the log, without reaction. `hybrid`: poses of the log until a CAV's
    presence changes the situation, then SUMO drives (vehicles without a log are reactive always)."""

    @model_validator(mode="after")
    def _check_logs(self) -> "Background":
        if self.mode == "replay":
            for vehicle in self.vehicles:
                if not vehicle.log:
                    raise ValueError(f"vehicle {vehicle.id}: expected a log to replay, found none")
        return self
