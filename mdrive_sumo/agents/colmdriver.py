"""`colmdriver` and `colmdriver-rule`: negotiate by language model, and by the rule that the paper has beside it."""

from dataclasses import replace
from pathlib import Path

from mdrive_sumo.agents.sharing import DEFENCE, SHARE, NegotiatingAgent
from mdrive_sumo.contract import Briefing, Observation, Reply
from mdrive_sumo.contract.agent_options import Config, Option
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.negotiation import LlmNegotiator, RuleNegotiator, read_llm_options
from mdrive_sumo.negotiation.chat_speaker import ChatSpeaker
from mdrive_sumo.negotiation.dialogue.answer_writers import AnswerWriter, FormulaWriter, NetworkWriter, RandomWriter
from mdrive_sumo.negotiation.dialogue.dialogue_decoder import WEIGHTS, load_decoder
from mdrive_sumo.negotiation.dialogue.dialogue_view import OwnKnowledge
from mdrive_sumo.negotiation.dialogue.vocabulary import load_vocabulary
from mdrive_sumo.negotiation.language_model import LanguageModel
from mdrive_sumo.negotiation.llm_negotiator import LLM_NEGOTIATION
from mdrive_sumo.negotiation.local_speaker import LocalSpeaker
from mdrive_sumo.negotiation.speaker import Speaker
from mdrive_sumo.negotiation.transcript import is_of_model_on_board
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


TALK_OPTIONS = {
    **SHARE,
    "words": Option(1, 0, 1, is_switch=True),
    "critic": Option(1, 0, 1, is_switch=True),
    "obey": Option(1, 0, 1, is_switch=True),
}
"""words: 0: messages of a model on board have a head only. critic: 0: one round, whatever the critic says of it.
obey: 0: drive as if nothing had been agreed. They take parts away, to measure what each is worth."""
DRIVING = (*DRIVING_OPTIONS, *DEFENCE, *TALK_OPTIONS, "detector")
TALKS = ("endpoint", "model", "formula", "random")
"""What speaks: a service, the own network, or one of its stand-ins in `answer_writers`."""


class ColmdriverAgent(NegotiatingAgent):
    """Shares perception; a language model speaks for each CAV and says what was agreed (protocol 10.4)."""

    name = "colmdriver"

    def __init__(self, config: Config) -> None:
        weights, talk = _read_weights(config), _read_talk(config)
        self._talk = talk
        asking = {name: value for name, value in config.items() if name not in (*DRIVING, "talk", "weights")}
        others = (*DRIVING, "talk", "weights")
        self._settings, self._instant = read_llm_options(self.name, asking, others, is_on_board=talk != "endpoint")
        super().__init__({name: value for name, value in config.items() if name in DRIVING}, TALK_OPTIONS)
        needs_network = talk == "model" and not self._settings.transcript
        self._decoder = load_decoder(weights or WEIGHTS) if needs_network else None
        self._seen: Observation | None = None
        self.speaker: Speaker | None = None
        """What speaks for this CAV, from `start` on."""
        self.negotiator: LlmNegotiator | None = None

    def build_negotiator(self, briefing: Briefing) -> LlmNegotiator:
        """Return a negotiator with this agent's speaker; where that gives nothing usable the rule decides."""
        has_critic = bool(self._options.values["critic"])
        parameters = LLM_NEGOTIATION if has_critic else replace(LLM_NEGOTIATION, rounds=1)
        self.speaker = self._build_speaker(briefing)
        self.negotiator = LlmNegotiator(self.speaker, self._instant, parameters, briefing.v2x_rate)
        return self.negotiator

    def _build_speaker(self, briefing: Briefing) -> Speaker:
        model = LanguageModel(self._settings, briefing.seed)
        if self._talk == "endpoint":
            return ChatSpeaker(model)
        writer = None if self._settings.transcript else self._build_writer(briefing)
        return LocalSpeaker(briefing.ego_id, model, writer, load_vocabulary(), self._gather_knowledge)

    def _build_writer(self, briefing: Briefing) -> AnswerWriter:
        has_words = bool(self._options.values["words"])
        if self._decoder is not None:
            return NetworkWriter(self._decoder, has_words)
        return FormulaWriter() if self._talk == "formula" else RandomWriter(load_vocabulary(), briefing.seed, has_words)

    def _gather_knowledge(self) -> OwnKnowledge | None:
        """Return what it knows beside the MCMs; None before it has planned."""
        if self._seen is None or self._ego_planner is None:
            return None
        planner = self._ego_planner.planner
        return OwnKnowledge.gather(self._briefing, self._seen, planner.s, planner.reason, self._tracker)

    def act(self, seen: Observation) -> Reply:
        """Return the plan, updated when it is due, and messages with detections, plan, words and what was agreed."""
        self._seen = seen
        return super().act(seen)


def _read_weights(config: Config) -> Path | None:
    """Return the file that the option `weights` names, if there is one. Raises InputError."""
    value = config.get("weights", "")
    if isinstance(value, str) and (not value or Path(value).suffix in (".onnx", ".json")):
        return Path(value) if value else None
    raise InputError(f"agent colmdriver: option weights: expected the path of an .onnx or .json file, found {value!r}")


def _read_talk(config: Config) -> str:
    """Return what speaks: as told, or as the other options and the packaged files suggest. Raises InputError."""
    talk = config.get("talk", "")
    endpoint, transcript = config.get("endpoint", ""), config.get("transcript", "")
    if talk not in ("", *TALKS):
        raise InputError(f"agent colmdriver: option talk: expected one of {', '.join(TALKS)}, found {talk!r}")
    if endpoint and talk not in ("", "endpoint"):
        raise InputError(f"agent colmdriver: option talk: expected 'endpoint' where one is given, found {talk!r}")
    if talk or endpoint:
        has_weights = config.get("weights") or transcript or WEIGHTS.is_file()
        if talk == "model" and not has_weights:
            raise InputError(
                "agent colmdriver: option talk: expected weights of a language model in this package or in the option"
                " weights, found none; talk formula needs none"
            )
        return str(talk or "endpoint")
    recorded = is_of_model_on_board(Path(str(transcript))) if transcript else None
    if recorded is not None:
        return "model" if recorded else "endpoint"
    return "model" if config.get("weights") or WEIGHTS.is_file() else "endpoint"
