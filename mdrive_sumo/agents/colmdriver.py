"""`colmdriver`: negotiates in words."""

from mdrive_sumo.agents.base import Config
from mdrive_sumo.agents.colmdriver_rule import ColmdriverRuleAgent
from mdrive_sumo.agents.negotiation.llm import LlmNegotiator
from mdrive_sumo.agents.negotiation.model import Model
from mdrive_sumo.agents.negotiation.options import llm_options
from mdrive_sumo.contract import Briefing

CRUISE = 8.0


class ColmdriverAgent(ColmdriverRuleAgent):
    """As `colmdriver-rule`, but a language model speaks for each CAV and says what was agreed (protocol 10.4)."""

    def __init__(self, config: Config) -> None:
        self._settings, self._instant = llm_options("colmdriver", config)
        super().__init__({"speed": CRUISE})

    def negotiator(self, briefing: Briefing) -> LlmNegotiator:
        """The model's voice; where it gives nothing usable the rule decides."""
        return LlmNegotiator(Model(self._settings, briefing.seed), self._instant)
