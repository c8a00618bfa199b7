"""`colmdriver` and `colmdriver-rule`: negotiate by language model, and by the rule that the paper has beside it."""

from mdrive_sumo.agents.sharing import DEFENCE, SHARE, NegotiatingAgent
from mdrive_sumo.contract import Briefing
from mdrive_sumo.contract.agent_options import Config, Option
from mdrive_sumo.negotiation import LlmNegotiator, RuleNegotiator, read_llm_options
from mdrive_sumo.negotiation.chat_speaker import ChatSpeaker
from mdrive_sumo.negotiation.language_model import LanguageModel
from mdrive_sumo.planning.driving_options import DRIVING_OPTIONS

RULE_OPTIONS = {
    "compat_ego0": Option(0, 0, 1),
    "share": Option(0, 0, 1, is_switch=True),
}
"""compat_ego0: 1: reproduce a defect of the original, see `RuleNegotiator`. share: as `SHARE`, but off by default: all
published results of `colmdriver-rule` are without shared perception."""


class ColmdriverRuleAgent(NegotiatingAgent):
    """Own sensors, and MCMs by which the one nearest to the conflict goes first and all others stop (protocol 10.5)."""

    name = "colmdriver-rule"

    def __init__(self, config: Config) -> None:
        super().__init__(config, RULE_OPTIONS)

    def build_negotiator(self, briefing: Briefing) -> RuleNegotiator:
        """Return a negotiator that applies the rule."""
        return RuleNegotiator(compat_ego0=bool(self._options.values["compat_ego0"]), rate=briefing.v2x_rate)


DRIVING = (*DRIVING_OPTIONS, *DEFENCE, *SHARE, "detector")


class ColmdriverAgent(NegotiatingAgent):
    """Shares perception; a language model speaks for each CAV and says what was agreed (protocol 10.4)."""

    name = "colmdriver"

    def __init__(self, config: Config) -> None:
        negotiation = {name: value for name, value in config.items() if name not in DRIVING}
        self._settings, self._instant = read_llm_options(self.name, negotiation, DRIVING)
        super().__init__({name: value for name, value in config.items() if name in DRIVING}, SHARE)

    def build_negotiator(self, briefing: Briefing) -> LlmNegotiator:
        """Return a negotiator that asks the model; where it gives nothing usable the rule decides."""
        model = LanguageModel(self._settings, briefing.seed)
        return LlmNegotiator(ChatSpeaker(model), self._instant, rate=briefing.v2x_rate)
