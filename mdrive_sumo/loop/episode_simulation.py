"""The one tick of the benchmark: judge, deliver, observe; then post, control, record, move."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

from mdrive_sumo.contract import (
    STANDSTILL,
    Briefing,
    Control,
    Message,
    Observation,
    Plan,
    Reply,
    SensorSpec,
)
from mdrive_sumo.contract.briefing import PROTOCOL_SPEED
from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.core.state import TICKS_PER_SECOND, End, Frame
from mdrive_sumo.episode import (
    ATTACKERS,
    SENSING_TRACK,
    Ending,
    EpisodeRecord,
    ReceivedMessages,
    Recorder,
    ThinkTimeEntry,
    quantize_frame,
)
from mdrive_sumo.loop.agent_driver import AgentFailure
from mdrive_sumo.loop.episode_config import VEHICLE, EpisodeConfig
from mdrive_sumo.loop.frame_source import FrameSource
from mdrive_sumo.loop.pseudonyms import rename_senders
from mdrive_sumo.scoring import criteria
from mdrive_sumo.sensing.briefing_builder import build_briefing
from mdrive_sumo.sensing.observation_builder import ObservationBuilder, build_sensing_frame
from mdrive_sumo.sensing.radio_scene_builder import RadioSceneBuilder, choose_environment
from mdrive_sumo.sensing.roadside_units import RoadsideUnits
from mdrive_sumo.sensing.sensing_frame import SensingFrame
from mdrive_sumo.sensing.sensor_kinds import SENSOR_KINDS, derive_sensing_track
from mdrive_sumo.sensing.signal_lamps import SignalLampObserver
from mdrive_sumo.v2x.attacks.falsifier import Falsifier
from mdrive_sumo.v2x.attacks.route_point import Receiver
from mdrive_sumo.v2x.channel import Channel
from mdrive_sumo.v2x.messages import FLOOD
from mdrive_sumo.v2x.radio.radio_scene import RadioScene
from mdrive_sumo.vehicle import control, dynamics


class EpisodeSimulation:
    """One episode, driven from outside: `reset`, then `step` until `is_done`, then `finish`.

    The caller owns the loop and the agents; `run_episode` is such a caller.
    """

    def __init__(
        self, config: EpisodeConfig, frames: FrameSource, sensors: Mapping[str, tuple[SensorSpec, ...]]
    ) -> None:
        """`sensors` maps the id of every CAV to its sensors. Raises InputError for an invalid sensor."""
        scenario = config.scenario
        egos = [ego.id for ego in scenario.egos]
        self._config, self._frames, self._egos = config, frames, egos
        self._controllers: dict[tuple[str, str], control.Controller] = {}
        self._controls: dict[str, Control] = dict.fromkeys(egos, STANDSTILL)
        self._plans: dict[str, Plan] = {}
        self._endings: dict[str, Ending] = {}
        self.active_egos = tuple(egos)
        """Ids of the CAVs in the world, also of those whose agent failed, in the order of the scenario file."""
        self._failures: dict[str, Ending] = {}
        """The CAVs without a working agent; their endings once they stand and nothing else drives."""
        self._pending_messages: dict[str, tuple[Message, ...]] = dict.fromkeys(egos, ())
        self._received: ReceivedMessages = {}
        self._scene: SensingFrame | None = None
        self._frame: Frame | None = None
        self._dimensions = frames.dimensions
        self.sensing_track = derive_sensing_track(sensors.values())
        """Whether any CAV is given lists of objects."""
        lying = {ATTACKERS: " ".join(sorted(config.attackers))} if config.attackers else {}
        about = {**config.about, SENSING_TRACK: self.sensing_track.value, **lying}
        self._recorder = Recorder(scenario.id, about, self._dimensions, config.pseudonyms)
        self._falsifier = _make_falsifier(config)
        channel_seed = derive_seed(config.seed, scenario.id, "channel")
        self._channel = Channel(config.options.comm, channel_seed, choose_environment(config.roads))
        radio = config.options.comm.radio
        self._radio_scenes = RadioSceneBuilder(radio, config.roads, channel_seed) if radio is not None else None
        self.briefings: Mapping[str, Briefing] = self._build_briefings()
        """What the agent of each CAV learns before the first tick."""
        self.is_done = False
        """Whether every CAV has ended and the last frame is recorded."""
        common = config.sensor_context
        self._roadside = RoadsideUnits(scenario.rsus if config.options.comm.on else (), common, config.options.v2x_rate)
        self._senses = ObservationBuilder(sensors, self.briefings, common)
        show_lamps = any(SENSOR_KINDS[spec.kind].shows_lamps for specs in sensors.values() for spec in specs)
        self._signal_lamps = SignalLampObserver(config.roads) if show_lamps else None

    @property
    def frame(self) -> Frame:
        """The current frame at recording resolution. Raises RuntimeError before `reset`."""
        if self._frame is None:
            raise RuntimeError("episode: expected reset() before anything else")
        return self._frame

    @property
    def tick(self) -> int:
        """Tick of the current frame."""
        return self.frame.tick

    @property
    def failed_agents(self) -> dict[str, str]:
        """Why the agent of a CAV failed, by CAV id."""
        return {ego: f"{failure.failure}: {failure.text}" for ego, failure in self._failures.items()}

    @property
    def digest(self) -> str:
        """Digest of all ticks before the current one, hexadecimal; "" in tick 0. Of the whole episode once it is done.

        Two episodes of a scenario with the same digest are the same up to here.
        """
        return self._recorder.digest

    @property
    def endings(self) -> Mapping[str, Ending]:
        """How CAVs have ended, by CAV id."""
        return MappingProxyType(self._endings)

    @property
    def received_messages(self) -> ReceivedMessages:
        """The messages that arrived in the current tick, as each CAV received them; senders by the scenario's ids."""
        return MappingProxyType(dict(self._received))

    def reset(self) -> dict[str, Observation]:
        """Start the episode; return the observations of its first frame by CAV.

        Raises RuntimeError on a second call: a world runs one episode.
        """
        if self._frame is not None:
            raise RuntimeError("episode: expected one reset(), found a second one")
        self._frame = quantize_frame(self._frames.start())
        return self._begin_tick(())

    def step(self, replies: Mapping[str, Reply], busy: Collection[str] = ()) -> dict[str, Observation]:
        """Apply the replies to the current frame and advance by one tick; return the new observations by CAV.

        `replies` must satisfy the contract (`contract.check_reply`). A CAV without a reply repeats its last control.
        `busy`: CAVs that get no observation in the next tick; their messages wait for their next one.
        The result is empty once every CAV has ended. Raises WorldError if the simulator fails.
        """
        if self.is_done:
            raise RuntimeError("episode: expected no step() after the last CAV ended")
        self._end_tick(replies)
        if self.is_done:
            return {}
        self._frame = quantize_frame(self._frames.advance(self.frame, self._controls))
        return self._begin_tick(busy)

    def fail_agent(self, ego: str, error: AgentFailure) -> None:
        """Brake a CAV from the current tick on (tick 0 before `reset`) because its agent failed; a second call is void.

        The CAV gets no more observations. It stays in the world, and what it hits or is hit by counts. It ends by the
        usual criteria, or when it stands and no CAV with an agent is left, in any case as `End.AGENT_FAILED`.
        """
        if ego in self._endings:
            return
        tick = 0 if self._frame is None else self._frame.tick
        failure = Ending(ego, tick, End.AGENT_FAILED, error.failure, error.text, tick)
        self._failures.setdefault(ego, failure)

    def finish(self, think_times: Sequence[ThinkTimeEntry] = ()) -> EpisodeRecord:
        """Return the read-only record of the finished episode."""
        if not self.is_done:
            raise RuntimeError("episode: expected every CAV to have ended before finish()")
        endings = [self._endings[ego.id] for ego in self._config.scenario.egos]
        channel = self._channel
        return self._recorder.finish(endings, channel.sent_messages(), think_times, channel.list_busy_ratios())

    def _build_briefings(self) -> dict[str, Briefing]:
        config, facts = self._config, dynamics.to_vehicle_facts(VEHICLE)
        limits = criteria.compute_time_limit_ticks(config.scenario)
        desired_speed = PROTOCOL_SPEED if config.scenario.speeds == "protocol" else None
        detector = config.options.sensing.standard_detector
        briefings: dict[str, Briefing] = {}
        for ego in config.scenario.egos:
            seed = derive_seed(config.seed, config.scenario.id, "agent", ego.id)
            length, width = self._dimensions[ego.id]
            vehicle = replace(facts, length=length, width=width)
            limit_s = limits[ego.id] / TICKS_PER_SECOND
            briefing = build_briefing(
                ego, config.roads, vehicle, seed, limit_s, detector,
                pseudonym=config.pseudonyms[ego.id], desired_speed=desired_speed,
                v2x_rate=config.options.v2x_rate.value,
            )  # fmt: skip
            if config.options.clock.kind == "measured":
                _ = briefing.route_room  # computed now: it is no think time
            briefings[ego.id] = briefing
        return briefings

    def _begin_tick(self, busy: Collection[str]) -> dict[str, Observation]:
        """End CAVs, deliver messages and return the observations of every CAV with an agent that is not busy."""
        frame = self.frame
        self._judge(frame)
        self._received = self._channel.deliver(frame.tick, self.active_egos)
        for ego, messages in self._received.items():
            if messages:
                readable = [message for message in messages if message.type != FLOOD]
                self._pending_messages[ego] += rename_senders(readable, self._config.pseudonyms)
        observers = tuple(ego for ego in self.active_egos if ego not in busy and ego not in self._failures)
        is_scene_needed = self._signal_lamps is not None or self._roadside.is_due(frame.tick)
        if is_scene_needed or self._senses.needs_frame(observers):
            self._scene = build_sensing_frame(frame, self._dimensions, self._signal_lamps)
        else:
            self._scene = None
        messages_by_observer = {ego: self._pending_messages[ego] for ego in observers}
        self._pending_messages |= dict.fromkeys(observers, ())
        observations = self._senses.build_observations(frame, self._scene, self._plans, messages_by_observer)
        if not self.active_egos:
            self._end_tick({})
        return observations

    def _end_tick(self, replies: Mapping[str, Reply]) -> None:
        """Post messages, update plans and controls, and record the current frame."""
        replies = {e: reply for e, reply in replies.items() if e not in self._endings and e not in self._failures}
        self._post_messages(self.frame, replies)
        self._update_plans(replies)
        self._update_controls(self.frame, replies)
        self._recorder.add(self.frame, self._controls, self._plans, self._received)
        self.is_done = not self.active_egos

    def _judge(self, frame: Frame) -> None:
        """End the CAVs that arrived, deviated, are blocked or timed out in this frame (protocol 5 to 7).

        A CAV whose agent failed keeps that outcome, whatever ends it.
        """
        for ego, end in self._frames.find_ends(frame, self.active_egos).items():
            self._end(ego, end)
        self._end_failed_cavs()
        for failure in self._config.replayed_failures:
            if failure.failed_tick == frame.tick and failure.ego not in self._endings:
                self._failures[failure.ego] = failure

    def _end(self, ego: str, end: End) -> None:
        failed, tick = self._failures.get(ego), self.frame.tick
        self._endings[ego] = replace(failed, tick=tick) if failed is not None else Ending(ego, tick, end)
        self.active_egos = tuple(one for one in self.active_egos if one != ego)

    def _end_failed_cavs(self) -> None:
        """End the CAVs whose agents failed in an earlier tick once all of them stand and no other CAV is left."""
        if not self._failures:
            return
        left = self.active_egos
        tick, egos = self.frame.tick, self.frame.egos
        failed_ticks = [self._failures[ego].failed_tick for ego in left if ego in self._failures]
        have_failed = len(failed_ticks) == len(left) and all(
            found is not None and found < tick for found in failed_ticks
        )
        if have_failed and all(egos[ego].speed == 0.0 for ego in left):
            for ego in left:
                self._end(ego, End.AGENT_FAILED)

    def _post_messages(self, frame: Frame, replies: Mapping[str, Reply]) -> None:
        """Record the notes of the agents, and post the messages of CAVs and road-side units."""
        messages = {ego: reply.messages for ego, reply in replies.items() if reply.messages}
        for ego, reply in replies.items():
            self._recorder.note(frame.tick, ego, reply.notes)
        if self._scene is not None and self._roadside.is_due(frame.tick):
            messages |= self._roadside.compose_messages(self._scene)
        if self._falsifier is not None:
            messages = self._falsify(self._falsifier, frame, messages)
        if messages:
            egos = self.active_egos
            positions = {ego: (frame.egos[ego].x, frame.egos[ego].y) for ego in egos} | self._roadside.positions
            self._channel.send(frame.tick, messages, positions, receivers=egos, scene=self._build_radio_scene(frame))

    def _build_radio_scene(self, frame: Frame) -> RadioScene | None:
        """Return the scene of all stations; None if the channel is no radio."""
        if self._radio_scenes is None:
            return None
        scene = self._scene if self._scene is not None else build_sensing_frame(frame, self._dimensions)
        with_background = self._channel.is_background_due(frame.tick)
        return self._radio_scenes.build(scene, self.active_egos, self._roadside.positions, with_background)

    def _falsify(
        self, falsifier: Falsifier, frame: Frame, messages: Mapping[str, tuple[Message, ...]]
    ) -> dict[str, tuple[Message, ...]]:
        """Return the messages that leave the stations: those of attackers lie."""
        receivers = {ego: self._describe_receiver(frame, ego) for ego in self.active_egos}
        stations = {*self.active_egos, *self._roadside.positions} - {*self._failures}
        return falsifier.falsify(frame.tick, messages, receivers, stations)

    def _describe_receiver(self, frame: Frame, ego: str) -> Receiver:
        state = frame.egos[ego]
        name, route = self._config.pseudonyms[ego], self.briefings[ego].route_xy
        return Receiver(name, state.x, state.y, state.speed, route)

    def _update_plans(self, replies: Mapping[str, Reply]) -> None:
        for ego, reply in replies.items():
            if reply.plan is not None:
                self._plans[ego] = reply.plan
            else:
                self._plans.pop(ego, None)

    def _update_controls(self, frame: Frame, replies: Mapping[str, Reply]) -> None:
        """Take the control of each reply, or that of the controller that tracks its plan; drop CAVs that ended.

        A CAV whose agent failed brakes.
        """
        for ego, reply in replies.items():
            self._controls[ego] = reply.control if reply.control is not None else self._track_plan(ego, frame)
        driven = [ego for ego in self.active_egos if ego not in self._failures]
        self._plans = {ego: self._plans[ego] for ego in driven if ego in self._plans}
        self._controls = {ego: self._controls[ego] if ego in driven else STANDSTILL for ego in self.active_egos}

    def _track_plan(self, ego: str, frame: Frame) -> Control:
        """Return the control that follows the plan from where the CAV takes itself to be: plans are in that frame."""
        plan, state = self._plans[ego], self._senses.estimate_own_state(frame, ego)
        key = (ego, plan.controller)
        if key not in self._controllers:
            self._controllers[key] = control.CONTROLLERS[plan.controller](dynamics.to_vehicle_facts(VEHICLE))
        return self._controllers[key].follow(plan, state, 0)


def _make_falsifier(config: EpisodeConfig) -> Falsifier | None:
    """Return what changes the messages of attackers; None if the scenario has none."""
    attack = config.options.parsed_attack
    if attack is None or not config.attackers:
        return None
    names = {attacker: config.pseudonyms[attacker] for attacker in config.attackers}
    return Falsifier(attack, names, derive_seed(config.seed, config.scenario.id, "attack"))
