"""Options of the agent that negotiates by language model."""

from collections.abc import Mapping

from mdrive_sumo.contract.agent_options import Config, Option, read_options
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.negotiation.language_model import LanguageModelSettings, check_settings

TEXTS: Mapping[str, str] = {
    "endpoint": "",
    "model": "default",
    "api_key_env": "",
    "transcript": "",
    "rounds": "channel",
}
NUMBERS: Mapping[str, Option] = {
    "timeout_s": Option(30.0, 0.1, 600.0),
    "tries": Option(3, 1, 10),
    "max_calls": Option(300, 0, 100_000),
    "max_tokens_total": Option(400_000, 0, 1e9),
    "give_up_after": Option(3, 1, 1000),
}
ROUNDS = ("channel", "instant")


def read_llm_options(agent: str, config: Config, others: tuple[str, ...] = ()) -> tuple[LanguageModelSettings, bool]:
    """Return the settings of the model and whether rounds are instant; others: names of options read elsewhere.

    Raises InputError for an unknown name or an invalid value.
    """
    unknown = sorted(set(config) - set(TEXTS) - set(NUMBERS))
    if unknown:
        known = ", ".join(sorted((*TEXTS, *NUMBERS, *others)))
        raise InputError(f"agent {agent}: expected options among ({known}), found {unknown[0]!r}")
    texts = {name: _read_text(agent, name, config.get(name, default)) for name, default in TEXTS.items()}
    numbers = read_options(agent, {name: config[name] for name in NUMBERS if name in config}, NUMBERS)
    rounds = texts["rounds"]
    if rounds not in ROUNDS:
        raise InputError(f"agent {agent}: option rounds: expected {' or '.join(ROUNDS)}, found {rounds!r}")
    settings = LanguageModelSettings(
        endpoint=texts["endpoint"],
        model=texts["model"],
        api_key_env=texts["api_key_env"],
        transcript=texts["transcript"],
        timeout_s=numbers["timeout_s"],
        tries=int(numbers["tries"]),
        max_calls=int(numbers["max_calls"]),
        max_tokens_total=int(numbers["max_tokens_total"]),
        give_up_after=int(numbers["give_up_after"]),
    )
    return check_settings(settings), rounds == "instant"


def _read_text(agent: str, name: str, value: object) -> str:
    """Return the value; raise InputError unless it is a text."""
    if not isinstance(value, str):
        raise InputError(f"agent {agent}: option {name}: expected a text, found {value!r}")
    return value
