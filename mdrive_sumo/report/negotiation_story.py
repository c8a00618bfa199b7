"""What one CAV asked, answered and said in negotiations, in sentences without their subject."""

from collections.abc import Iterator, Sequence

from mdrive_sumo.core.clean_text import truncate
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.negotiation.conversation import parse_utterance
from mdrive_sumo.report.reasons import join_names
from mdrive_sumo.v2x.messages import MCM, TEXT, Intention, Mcm, MessageError, decode

MAX_TEXT = 200
"""Characters of a text message in a sentence."""
INTENTION_WORDS = {
    Intention.STOP: "stop",
    Intention.SLOWER: "slow down",
    Intention.KEEP: "keep its speed",
    Intention.FASTER: "speed up",
}


def tell_negotiation(episode: EpisodeRecord, ego: str) -> Iterator[tuple[int, str]]:
    """Yield (tick, sentence) of what a CAV said, and of what it asked and answered whenever that changed."""
    before = ""
    for sent in episode.messages:
        message = sent.message
        if message.sender != ego or message.type not in (MCM, TEXT):
            continue
        try:
            content = decode(message)
        except MessageError:
            continue
        if isinstance(content, str):
            yield message.tick, _quote(episode.restore_names(content))
        elif isinstance(content, Mcm):
            terms = _describe_terms(episode, ego, content)
            if terms and terms != before:
                yield message.tick, terms + _describe_intention(episode, ego, content)
            before = terms


def _quote(text: str) -> str:
    """Return a text message in quotes, with its round if it belongs to a conversation."""
    utterance = parse_utterance(text)
    said = text if utterance is None else utterance.text
    quoted = f'"{truncate(" ".join(said.split()), MAX_TEXT)}"'
    if utterance is None:
        return f"says {quoted}"
    verb = "objects and opens" if utterance.is_critic else "says in"
    return f"{verb} round {utterance.round}: {quoted}"


def _describe_terms(episode: EpisodeRecord, ego: str, mcm: Mcm) -> str:
    """Return what an MCM negotiates and with which CAVs, in words; "" if it does not."""
    rename = episode.restore_name
    group = [rename(name) for name in mcm.group]
    partners = [name for name in sorted(group) if name != ego]
    answers = {rename(name): accepted for name, accepted in mcm.answers.items()}
    asked: dict[Intention, list[str]] = {}
    for name, intention in sorted((rename(name), intention) for name, intention in mcm.requests.items()):
        if name != ego:
            asked.setdefault(intention, []).append(name)
    parts = [f"asks {_join_cavs(names)} to {INTENTION_WORDS[intention]}" for intention, names in asked.items()]
    if answers.get(ego):
        parts.insert(0, f"asks all to pass in the order {', '.join(group)}")
    for accepted, verb in ((True, "agrees with"), (False, "refuses")):
        if names := sorted(name for name, yes in answers.items() if yes is accepted and name != ego):
            parts.append(f"{verb} {_join_cavs(names)}")
    if not partners and not parts:
        return ""
    head = f"negotiates with {_join_cavs(partners)}" if partners else "negotiates"
    return f"{head}: {', '.join(parts)}" if parts else head


def _describe_intention(episode: EpisodeRecord, ego: str, mcm: Mcm) -> str:
    """Return what the CAV says that it will do: it changes too often for sentences of its own."""
    names = {episode.restore_name(name): intention for name, intention in mcm.requests.items()}
    return f", will itself {INTENTION_WORDS[names[ego]]}" if ego in names else ""


def _join_cavs(names: Sequence[str]) -> str:
    return join_names(tuple(f"CAV {name}" for name in names))
