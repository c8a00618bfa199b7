"""`mdrive-sumo negotiate`."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from mdrive_sumo.cli.stored_run_options import find_one_scenario
from mdrive_sumo.core.clean_text import clean_line
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import DT
from mdrive_sumo.core.suggestion import suggest_name
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.negotiation.critic import avoid_slow_keeping, evaluate_actions
from mdrive_sumo.negotiation.dialogue.answers import assign_letters, replace_letters, restore_letters
from mdrive_sumo.negotiation.local_speaker import LocalSpeaker
from mdrive_sumo.negotiation.order_prediction import can_carry_out
from mdrive_sumo.runs.run_config import load_agent_config
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.scenario.variation import load_varied_scenario

if TYPE_CHECKING:
    from mdrive_sumo.learning.dialogue.held_round import TickGroup
    from mdrive_sumo.negotiation.speaker import GroupAgreement


@click.command("negotiate")
@click.argument("pattern", metavar="SCENARIO")
@click.option("--tick", type=click.IntRange(min=0), required=True, help="When they talk; a tick is 1/20 s.")
@click.option("--as", "cav", metavar="ID", help="Speak for this CAV yourself [default: its model speaks for each].")
@click.option("--suite", default="interdrive", show_default=True, metavar="NAME|DIR", help="Suite of the scenario.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the drive.")
@click.option("--agent-config", type=click.Path(path_type=Path), metavar="FILE", help="Options of `colmdriver`, JSON.")
def command(pattern: str, tick: int, cav: str | None, suite: str, seed: int, agent_config: Path | None) -> None:
    """Hold one round of a negotiation at a tick of a drive, and print what is said and agreed.

    `colmdriver` drives SCENARIO, an id or a glob that fits one, up to the tick. Then each CAV of a group in conflict
    says one message, the most central one says what was agreed, and the critic judges it. Without packaged weights and
    --agent-config the formula of `passing` speaks. With --as you read what a CAV knows and type its message.

    Exit codes: 0 done, 2 unusable input, such as a tick without CAVs in conflict: it names others.
    """
    from mdrive_sumo.learning.dialogue.held_round import find_group, hold_round
    from mdrive_sumo.loop import EpisodeConfig
    from mdrive_sumo.negotiation.dialogue.dialogue_decoder import WEIGHTS

    loaded = load_suite(suite)
    scenario = find_one_scenario(loaded, pattern)
    cavs = [ego.id for ego in scenario.egos]
    if cav is not None and cav not in cavs:
        hint = suggest_name(cav, cavs)
        raise InputError(f"--as: expected a CAV of {scenario.id} ({', '.join(cavs)}), found {cav!r:.40}{hint}")
    options = load_agent_config(agent_config) if agent_config else {} if WEIGHTS.is_file() else {"talk": "formula"}
    group = find_group(EpisodeConfig(*load_varied_scenario(loaded, scenario, seed), seed), options, tick, cav)
    talk = _PrintedTalk(group)
    echo(f"{scenario.id}, tick {tick} ({tick * DT:.1f} s): {talk.list_members()}")
    me = next((station for station, name in group.cav_by_station.items() if name == cav), None)
    replies = {} if me is None else {me: lambda: talk.ask_person(me)}
    talk.print_outcome(hold_round(group, replies, talk.print_message))


class _PrintedTalk:
    """A round as the terminal shows it: members by letter, as their models know them."""

    def __init__(self, group: "TickGroup") -> None:
        self._group = group
        self._letters = assign_letters(group.conversation.group)

    def list_members(self) -> str:
        """Return which letter is which CAV."""
        cavs = self._group.cav_by_station
        return ", ".join(f"{letter} is CAV {cavs[station]}" for station, letter in self._letters.items())

    def ask_person(self, station: str) -> str:
        """Return the message that a person types for a station, after what that station knows."""
        speaker, conversation = self._group.speakers[station], self._group.conversation
        if isinstance(speaker, LocalSpeaker):
            for line in speaker.describe(conversation, station, self._group.members):
                echo(f"  {clean_line(line)}")
        example = f"propose {'>'.join(self._letters.values())} slower: go first"
        typed = click.prompt(
            f"You are {self._letters[station]}; say something, such as {example}\n", "", show_default=False
        )
        text = " ".join(str(typed).split())
        return replace_letters(text, {letter: name for name, letter in self._letters.items()})

    def print_message(self, station: str, text: str) -> None:
        """Print what a member has said."""
        said = restore_letters(text, self._letters)
        echo(f"{self._letters[station]} says: {clean_line(said)}" if said else f"{self._letters[station]} is silent")

    def print_outcome(self, agreement: "GroupAgreement | None") -> None:
        """Print what was agreed, what the critic says of it, and which members cannot keep to it."""
        central = self._group.conversation.order[0]
        notes = [note.text for speaker in self._group.speakers.values() for note in speaker.notes]
        if agreement is None:
            reason = next((text for text in reversed(notes) if not text.startswith("{")), "nothing usable was said")
            echo(f"no agreement, the rule decides: {clean_line(reason)}")
            return
        members = tuple(self._group.members.values())
        order = agreement.order or tuple(sorted(agreement.actions))
        actions = avoid_slow_keeping(agreement.actions, members)
        parts = [f"{self._letters[name]} {actions[name].name.lower()}" for name in order]
        consensus = "" if agreement.consensus is None else f"; consensus {agreement.consensus:.0%}"
        how = "in this order" if agreement.order else "in no order"
        echo(f"agreed, says {self._letters[central]}: {', '.join(parts)}, {how}{consensus}")
        critique = evaluate_actions(members, actions, agreement.order)
        objection = restore_letters(critique.feedback, self._letters) or "no objection"
        echo(f"critic: safety {critique.safety:.2f}, efficiency {critique.efficiency:.2f}: {objection}")
        refusing = [
            self._letters[name]
            for name in agreement.order
            if not can_carry_out(name, members, actions, agreement.order)
        ]
        echo(f"cannot keep to it: {', '.join(refusing)}" if refusing else "all can keep to it")
