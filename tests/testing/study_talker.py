"""A third-party agent that talks, and brakes for a while when it receives a message."""

from collections.abc import Mapping

from mdrive_sumo.contract import Briefing, Control, Message, Observation, Reply, SensorSpec


class Talker:
    """Sends a text every half second; brakes in each tick of the first five seconds in which it receives one."""

    label = "sharing"

    def __init__(self, config: Mapping[str, object]) -> None:
        pass

    def sensors(self) -> tuple[SensorSpec, ...]:
        return ()

    def start(self, briefing: Briefing) -> None:
        pass

    def act(self, seen: Observation) -> Reply:
        brakes = bool(seen.messages) and seen.tick < 100
        control = Control(0.0, 1.0, 0.0) if brakes else Control(0.5, 0.0, 0.0)
        says = (Message("text", str(seen.tick).encode()),) if seen.tick % 10 == 0 else ()
        return Reply(control=control, messages=says)
