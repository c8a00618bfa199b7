"""Programs that drive a CAV as stated kinds of people might: they stand in for persons in trials of a study.

They are no model of any person and never count as one. A scripted driver sees what the on-board sensor and the V2X view
give, some time later; in between it expects that everything keeps its speed and heading (the anticipation of the human
driver model of Treiber, Kesting and Helbing, Delays, inaccuracies and anticipation in microscopic traffic models,
Physica A 360, 2006, 71-88). It decides as `idm` does and moves pedals and wheel no faster than hands and feet can.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import NamedTuple

from mdrive_sumo.agents.idm import IdmAgent, IdmParameters
from mdrive_sumo.contract import Briefing, Control, Objects, Observation
from mdrive_sumo.contract.briefing import PROTOCOL_SPEED
from mdrive_sumo.core import portable
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.seeding import derive_seed, draw_first_uniform
from mdrive_sumo.core.state import DT, TICKS_PER_SECOND
from mdrive_sumo.core.suggestion import describe_unknown
from mdrive_sumo.perception.object_tracker import ObjectTracker
from mdrive_sumo.planning import right_of_way
from mdrive_sumo.planning.parameters import RIGHT_OF_WAY, RightOfWayParameters
from mdrive_sumo.planning.planning_scale import find_cruise_speed
from mdrive_sumo.vehicle.control.plan_reader import round_control
from mdrive_sumo.vehicle.control.tracker import follow_plan

LOOK_TICKS = 2
"""[ticks] Between two looks at the surroundings: 10 Hz. Chosen: far below any reaction time."""
PEDAL_RATE = 4.0
"""[1/s] Full travel of a pedal in 0.25 s. Chosen: a foot that kicks."""
WHEEL_RATE = 1.2
"""[1/s] Share of the full lock: the 0.9 rad/s that `VehicleParameters.max_steer_rate` calls a fast hand."""
FOOT_TRANSFER_S = 0.2
"""[s] From throttle to brake. Green (2000, see `ATTENTIVE`) counts such movement time as about 0.2 s. It is part of the
reaction time of `DriverTraits`, so it only separates the pedals: both are never pressed at once."""
AXIS_STEPS = 255
"""Positions of a pedal or of each side of the wheel, as of a game controller with axes of 8 bits."""


@dataclass(frozen=True, slots=True)
class DriverTraits:
    """What makes a kind of scripted driver."""

    reaction_s: float
    """[s] From what is there to be seen until throttle or brake move for it."""
    speed_factor: float
    """Times the speed that the scenario asks for."""
    time_gap_s: float
    """[s] Behind the vehicle ahead."""
    crossing_gap_s: float
    """[s] Two cars that use the same area less than this apart are in conflict."""
    patience_s: tuple[float, float]
    """[s] Range of the time after which a waiting driver insists on going."""
    glance_s: tuple[float, float] = (0.0, 0.0)
    """[s] Range of the length of a glance away from the road; (0, 0): none."""
    watch_s: tuple[float, float] = (0.0, 0.0)
    """[s] Range of the time on the road between two glances."""


ATTENTIVE = DriverTraits(
    reaction_s=0.8,  # issue 40; between 0.70 to 0.75 s for an expected signal and 1.25 s for an unexpected one: Green,
    # "How long does it take to stop?", Transportation Human Factors 2 (2000) 195-216
    speed_factor=1.0,
    time_gap_s=1.5,  # chosen; within the 1 to 2 s that driving schools teach
    crossing_gap_s=RIGHT_OF_WAY.conflict_gap_s,
    patience_s=RIGHT_OF_WAY.patience_s,
)
DISTRACTED = replace(
    ATTENTIVE,
    reaction_s=1.5,  # Green (2000): a surprised driver
    glance_s=(1.5, 2.5),  # around the 2 s beyond which the risk of a crash doubles: Klauer et al., 100-Car Naturalistic
    # Driving Study, DOT HS 810 594 (2006)
    watch_s=(2.0, 5.0),  # chosen: eyes off the road for a third of the time
)
IMPATIENT = replace(
    ATTENTIVE,
    speed_factor=1.25,  # chosen: 36 km/h where 29 are asked for
    time_gap_s=0.6,  # chosen: half of what the attentive driver keeps, and less
    crossing_gap_s=0.3,  # chosen: a third of what the others take
    patience_s=(0.5, 1.5),  # chosen
)
DRIVER_KINDS: Mapping[str, DriverTraits] = MappingProxyType(
    {"attentive": ATTENTIVE, "distracted": DISTRACTED, "impatient": IMPATIENT}
)


def find_traits(kind: str) -> DriverTraits:
    """Return the traits of a kind of scripted driver. Raises InputError."""
    if kind not in DRIVER_KINDS:
        raise InputError(f"scripted driver: {describe_unknown(kind, DRIVER_KINDS)}")
    return DRIVER_KINDS[kind]


class _Look(NamedTuple):
    """What a driver saw at a tick."""

    tick: int
    objects: Objects
    signals: Mapping[str, str]


class _HumanDecision(IdmAgent):
    """The decisions of `idm` at every tick, with the gaps that a kind of driver accepts."""

    def __init__(self, cruise_speed: float, traits: DriverTraits, seed: int) -> None:
        super().__init__({"speed": cruise_speed, "time_gap": traits.time_gap_s})
        self._parameters = IdmParameters(decision_ticks=1)  # the reaction time is that of the looks, and no other
        self._traits, self._seed = traits, seed

    def start(self, briefing: Briefing) -> None:
        """Prepare as `idm` does, with the gaps and the patience of the traits."""
        super().start(briefing)
        gaps: RightOfWayParameters = replace(
            RIGHT_OF_WAY, conflict_gap_s=self._traits.crossing_gap_s, patience_s=self._traits.patience_s
        )
        self._yielding = right_of_way.YieldingPolicy(self._seed, gaps)


class ScriptedDriver:
    """Eyes, decisions, hands and feet of one scripted driver in one drive. The same name and seed drive the same."""

    def __init__(self, kind: str, has_v2x_view: bool, name: str = "") -> None:
        """has_v2x_view: whether it sees what the V2X view shows. name: drivers of one kind with different names glance
        away and lose patience at different times. Raises InputError for an unknown kind."""
        self.kind, self._traits, self._has_v2x_view, self._name = kind, find_traits(kind), has_v2x_view, name
        self._reaction_ticks = round(self._traits.reaction_s * TICKS_PER_SECOND)

    def start(self, briefing: Briefing) -> None:
        """Begin a drive."""
        self._briefing = briefing
        asked = find_cruise_speed(briefing, None, PROTOCOL_SPEED)
        patience_seed, glance_seed = (derive_seed(briefing.seed, part, self._name) for part in ("patience", "glances"))
        self._decision = _HumanDecision(self._traits.speed_factor * asked, self._traits, patience_seed)
        self._decision.start(briefing)
        self._tracker = ObjectTracker(briefing, briefing.standard_detector)
        self._looks: list[_Look] = []
        self._glances = GlancePattern(self._traits, glance_seed)
        self._control = Control(0.0, 0.0, 0.0)
        self._brake_allowed_tick = 0

    def act(self, seen: Observation) -> Control:
        """Return pedals and wheel for one tick; called for every tick in which the driver has the wheel."""
        self._look(seen)
        reply = self._decision.act(self._recall(seen))
        assert reply.plan is not None, "idm replies plans"
        wanted = follow_plan(reply.plan, seen.own, 0, self._briefing.vehicle)
        self._control = self._move(wanted, seen.tick)
        return self._control

    def _look(self, seen: Observation) -> None:
        """Remember what is to be seen now, unless the eyes are off the road."""
        if self._has_v2x_view:
            self._tracker.receive(seen.messages)
        is_due = not self._looks or seen.tick - self._looks[-1].tick >= LOOK_TICKS
        if not is_due or (self._looks and self._glances.is_away(seen.tick)):
            return
        self._looks.append(_Look(seen.tick, self._tracker.update(seen), dict(seen.signals)))

    def _recall(self, seen: Observation) -> Observation:
        """Return the surroundings as the driver takes them to be: seen a reaction time ago, moved on since then."""
        latest = seen.tick - self._reaction_ticks
        while len(self._looks) > 1 and self._looks[1].tick <= latest:
            self._looks.pop(0)
        look = self._looks[0]  # in the first moments the first look: the driver had the scene in view before the start
        return Observation(seen.tick, seen.own, extrapolate(look.objects, (seen.tick - look.tick) * DT), look.signals)

    def _move(self, wanted: Control, tick: int) -> Control:
        """Return where hands and feet are after a tick on their way to a control."""
        before, pedal, wheel = self._control, PEDAL_RATE * DT, WHEEL_RATE * DT
        throttle = _approach(before.throttle, wanted.throttle if not wanted.brake else 0.0, pedal)
        if before.throttle > 0.0:
            self._brake_allowed_tick = tick + round(FOOT_TRANSFER_S * TICKS_PER_SECOND)
        may_brake = throttle == 0.0 and tick >= self._brake_allowed_tick
        brake = _approach(before.brake, wanted.brake if may_brake else 0.0, pedal)
        if before.brake > 0.0 and brake > 0.0:
            throttle = 0.0
        return round_control(_snap(throttle), _snap(brake), _snap(_approach(before.steer, wanted.steer, wheel)))


class GlancePattern:
    """When the eyes are off the road: glances and looks in turn, with lengths drawn by number from the seed."""

    def __init__(self, traits: DriverTraits, seed: int) -> None:
        self._traits, self._seed = traits, seed
        self._number, self._is_away = 0, False
        self._until_tick = self._draw(traits.watch_s)

    def is_away(self, tick: int) -> bool:
        """Return whether the eyes are off the road; ticks must not decrease from call to call."""
        if self._traits.glance_s[1] == 0.0:
            return False
        while tick >= self._until_tick:
            self._number, self._is_away = self._number + 1, not self._is_away
            self._until_tick += self._draw(self._traits.glance_s if self._is_away else self._traits.watch_s)
        return self._is_away

    def _draw(self, range_s: tuple[float, float]) -> int:
        """Return a length [ticks] within a range [s], at least one tick."""
        share = draw_first_uniform(self._seed, self._number)
        return max(1, round((range_s[0] + share * (range_s[1] - range_s[0])) * TICKS_PER_SECOND))


def extrapolate(objects: Objects, elapsed_s: float) -> Objects:
    """Return the objects `elapsed_s` [s] later if each keeps its speed and its heading."""
    travelled = objects.speed * elapsed_s
    cos, sin = portable.cos_sin(objects.yaw)
    return replace(objects, x=objects.x + travelled * cos, y=objects.y + travelled * sin)


def _approach(value: float, wanted: float, most: float) -> float:
    return min(max(wanted, value - most), value + most)


def _snap(value: float) -> float:
    return round(value * AXIS_STEPS) / AXIS_STEPS
