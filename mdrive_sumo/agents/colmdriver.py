"""`colmdriver`: negotiates by language model."""

from mdrive_sumo.agents.colmdriver_rule import ColmdriverRuleAgent
from mdrive_sumo.contract.agent_options import Config
from mdrive_sumo.negotiation import LlmNegotiator, read_llm_options
from mdrive_sumo.negotiation.language_model import LanguageModel
from mdrive_sumo.planning.driving_options import DRIVING_OPTIONS

DRIVING = (*DRIVING_OPTIONS, "detector")


class ColmdriverAgent(ColmdriverRuleAgent):
    """As `colmdriver-rule`, but a language model speaks for each CAV and says what was agreed (protocol 10.4)."""

    name = "colmdriver"

    def __init__(self, config: Config) -> None:
        negotiation = {name: value for name, value in config.items() if name not in DRIVING}
        self._settings, self._instant = read_llm_options(self.name, negotiation, DRIVING)
        super().__init__({name: value for name, value in config.items() if name in DRIVING})

    def build_negotiator(self, seed: int) -> LlmNegotiator:
        """Return a negotiator that asks the model; where it gives nothing usable the rule decides."""
        return LlmNegotiator(LanguageModel(self._settings, seed), self._instant)
