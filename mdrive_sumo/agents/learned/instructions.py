"""Instructions in English for the counterpart of LMDrive: composed from navigation, with paraphrases.

An instruction says what the route does next; a notice about a stop sign or the goal follows it. Both are drawn from
fixed lists, so training and driving speak the same language, and the vocabulary is closed.
"""

import re
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from mdrive_sumo.agents.learned.navigation import Navigation
from mdrive_sumo.agents.learned.system_spec import COMMANDS, INSTRUCTION_WORDS
from mdrive_sumo.core.seeding import derive_seed

STOP_NOTICE_M = 25.0
GOAL_NOTICE_M = 20.0
"""How near [m] a stop line or the goal is when the notice about it begins. Design choices."""

PHRASES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "follow": (
            "Follow the road.", "Stay in your lane.", "Keep going along this road.", "Continue straight ahead.",
            "Drive on and keep your lane.", "Just follow the lane ahead of you.", "Maintain your course.",
        ),
        "left": (
            "Turn left ahead.", "Take the next left.", "Make a left turn at the junction.", "Go left here.",
            "At the intersection, turn left.", "Your route bends to the left.", "Please turn to the left.",
        ),
        "right": (
            "Turn right ahead.", "Take the next right.", "Make a right turn at the junction.", "Go right here.",
            "At the intersection, turn right.", "Your route bends to the right.", "Please turn to the right.",
        ),
        "change-left": (
            "Change to the left lane.", "Move one lane to the left.", "Merge left.", "Switch into the left lane.",
            "Take the lane on your left.", "Please get into the left lane.", "Shift over to the left lane.",
        ),
        "change-right": (
            "Change to the right lane.", "Move one lane to the right.", "Merge right.", "Switch into the right lane.",
            "Take the lane on your right.", "Please get into the right lane.", "Shift over to the right lane.",
        ),
    }
)  # fmt: skip
"""Paraphrases by command."""
NOTICES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "": ("",),
        "stop": (
            "Stop at the stop sign.", "Watch for the stop sign.", "A stop sign is near.", "Halt at the line.",
            "Obey the stop sign.", "There is a stop sign ahead.",
        ),
        "goal": (
            "Your destination is near.", "You are almost there.", "The goal is just ahead.", "You will arrive soon.",
            "The trip ends here.", "You have nearly arrived.",
        ),
    }
)  # fmt: skip
"""Paraphrases by what is noticed."""
PADDING, UNKNOWN = 0, 1
_WORD = re.compile(r"[a-z]+")


def split_words(text: str) -> list[str]:
    """Return the words of a text in lower case, without punctuation."""
    return _WORD.findall(text.lower())


def _build_vocabulary() -> tuple[str, ...]:
    texts = [text for phrases in (*PHRASES.values(), *NOTICES.values()) for text in phrases]
    return ("<padding>", "<unknown>", *sorted({word for text in texts for word in split_words(text)}))


VOCABULARY: tuple[str, ...] = _build_vocabulary()
"""Word by number. Weights of the counterpart of LMDrive belong to it: after a change of a phrase they are invalid."""
_NUMBERS: Mapping[str, int] = {word: number for number, word in enumerate(VOCABULARY)}


def find_situation(navigation: Navigation) -> tuple[str, str]:
    """Return the command ("left", ...) and the notice ("", "stop" or "goal") that an instruction speaks of."""
    is_stopping, is_arriving = navigation.stop_m < STOP_NOTICE_M, navigation.goal_m < GOAL_NOTICE_M
    return COMMANDS[navigation.command], "stop" if is_stopping else "goal" if is_arriving else ""


def compose_instruction(navigation: Navigation, variant: int) -> str:
    """Return the instruction. variant: any number >= 0; equal numbers give equal words in equal situations."""
    command, notice = find_situation(navigation)
    phrases, notices = PHRASES[command], NOTICES[notice]
    return f"{phrases[variant % len(phrases)]} {notices[variant // len(phrases) % len(notices)]}".rstrip()


class RouteInstructor:
    """Instructs one car: in new words, drawn by the seed, when the command of the route or the notice changes."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._situation: tuple[str, str] | None = None
        self._instruction, self._given = "", 0

    def instruct(self, navigation: Navigation) -> str:
        """Return the instruction that holds now."""
        situation = find_situation(navigation)
        if situation != self._situation:
            variant = derive_seed(self._seed, "instruction", str(self._given))
            self._situation, self._instruction = situation, compose_instruction(navigation, variant)
            self._given += 1
        return self._instruction


def encode_instruction(text: str) -> npt.NDArray[np.int64]:
    """Return the numbers (INSTRUCTION_WORDS,) of the words in `VOCABULARY`: 0 pads, 1 is an unknown word.

    Words beyond `INSTRUCTION_WORDS` are left out; no instruction composed here has so many.
    """
    encoded = np.full(INSTRUCTION_WORDS, PADDING, dtype=np.int64)
    numbers = [_NUMBERS.get(word, UNKNOWN) for word in split_words(text)[:INSTRUCTION_WORDS]]
    encoded[: len(numbers)] = numbers
    return encoded
