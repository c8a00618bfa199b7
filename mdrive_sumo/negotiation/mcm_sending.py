"""When a negotiator sends the MCM of a planning step, and for how long others remember it: by the sending rate."""

from mdrive_sumo.contract import Message
from mdrive_sumo.contract.briefing import V2xRate
from mdrive_sumo.negotiation.peer_table import ETSI_MEMORY_TICKS, MEMORY_TICKS
from mdrive_sumo.v2x.messages import Mcm
from mdrive_sumo.v2x.services.mcm_rule import McmRule
from mdrive_sumo.v2x.shared_reading import decode_shared


class McmSending:
    """The MCMs of one CAV: all of them at the rate `fixed`, those that `McmRule` wants at the rate `etsi`."""

    def __init__(self, rate: V2xRate) -> None:
        self._rule = None if rate == "fixed" else McmRule()
        self.memory_ticks = MEMORY_TICKS if rate == "fixed" else ETSI_MEMORY_TICKS
        """A station that has been silent for longer is dropped."""

    def is_due(self, tick: int, message: Message) -> bool:
        """Return whether the MCM of this planning step is to be sent; it then counts as sent."""
        if self._rule is None:
            return True
        mcm = decode_shared(message)
        assert isinstance(mcm, Mcm), "expected the own MCM"
        return self._rule.check(tick, mcm)
