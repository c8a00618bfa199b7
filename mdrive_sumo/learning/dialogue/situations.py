"""Situation: a group of CAVs in conflict in a drive, what each of them knows, and how orders of passing turn out.

Situations are the raw material of dialogues. A file holds those of one training scenario (JSON, gzip).
"""

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.core.output_files import write_bytes
from mdrive_sumo.negotiation.dialogue.dialogue_view import DialogueView
from mdrive_sumo.scenario.scenario import describe_first_error

MAX_FILE_BYTES = 2**28
"""Unpacked; a scenario has some tens of situations of about 4 kB."""
SAME_SCORE = 0.01
"""Outcomes that differ by less are equal: 0.6 m a member in 8 s."""


@dataclass(frozen=True, slots=True)
class OrderOutcome:
    """How the drive went on with an order of passing, in the simulation."""

    order: str
    """Letters of all members."""
    progress: float
    """Mean distance driven by the members, as a share of driving on freely."""
    contacts: int
    """Contacts of members with anything."""
    near_s: float
    """Time for which members were about to touch a road user [s]."""

    @property
    def score(self) -> float:
        """One number, greater is better: a contact costs more than to stand, so does half a second of danger."""
        return self.progress - 2.0 * (self.contacts > 0) - min(self.near_s, 1.0)


@dataclass(frozen=True, slots=True)
class Situation:
    """One group at one tick."""

    place: str
    """Name of the network."""
    scenario: str
    tick: int
    speakers: str
    """Letters, in the order in which the members speak."""
    views: tuple[DialogueView, ...]
    """What each member knows, by letter."""
    orders: Mapping[str, str]
    """Order of passing by teacher: "rule", "passing", and "omniscient" if its drive tells one."""
    outcomes: tuple[OrderOutcome, ...] = ()
    """Of the orders that were simulated; none if the situation was not searched."""

    @property
    def letters(self) -> str:
        """Letters of all members, in their order."""
        return "".join(sorted(self.speakers))

    def get_view(self, letter: str) -> DialogueView:
        """Return what a member knows."""
        return self.views[self.letters.index(letter)]

    def choose_order(self) -> str:
        """Return the order that is taught: the best one simulated, else that of `passing`.

        Among equally good ones it is that of `passing`, `omniscient`, the rule, or the one that sorts first.
        """
        if not self.outcomes:
            return self.orders["passing"]
        best = max(outcome.score for outcome in self.outcomes)
        good = {outcome.order for outcome in self.outcomes if outcome.score >= best - SAME_SCORE}
        taught = [self.orders[name] for name in ("passing", "omniscient", "rule") if name in self.orders]
        return next((order for order in taught if order in good), min(good))

    def find_worse(self, margin: float) -> list[str]:
        """Return the simulated orders whose score is lower than that of the taught one by a margin or more."""
        scores = {outcome.order: outcome.score for outcome in self.outcomes}
        limit = scores[self.choose_order()] - margin if scores else 0.0
        return sorted(order for order, score in scores.items() if score <= limit)


def rename_members(situation: Situation, names: Mapping[str, str]) -> Situation:
    """Return the situation with other letters; names: the new letter of each."""
    table = str.maketrans(dict(names))
    views = [_rename_view(view, table) for view in situation.views]
    return replace(
        situation,
        speakers=situation.speakers.translate(table),
        views=tuple(sorted(views, key=lambda view: view.me)),
        orders={teacher: order.translate(table) for teacher, order in situation.orders.items()},
        outcomes=tuple(replace(one, order=one.order.translate(table)) for one in situation.outcomes),
    )


def _rename_view(view: DialogueView, table: dict[int, str]) -> DialogueView:
    members = [
        replace(one, letter=one.letter.translate(table), follows=one.follows.translate(table)) for one in view.members
    ]
    sources = [one.source.translate(table) if len(one.source) == 1 else one.source for one in view.objects]
    return replace(
        view,
        me=view.me.translate(table),
        members=tuple(sorted(members, key=lambda one: one.letter)),
        yields=tuple(sorted((a.translate(table), b.translate(table)) for a, b in view.yields)),
        objects=tuple(replace(one, source=source) for one, source in zip(view.objects, sources, strict=True)),
    )


_SITUATIONS = TypeAdapter(tuple[Situation, ...])


def write_situations(path: Path, situations: Sequence[Situation]) -> int:
    """Write a file and return its size [bytes]. Raises OSError."""
    packer = zlib.compressobj(6, zlib.DEFLATED, 31)
    content = packer.compress(_SITUATIONS.dump_json(tuple(situations))) + packer.flush()
    write_bytes(path, content)
    return len(content)


def read_situations(path: Path) -> tuple[Situation, ...]:
    """Return the situations of a file. Raises InputError for one that is missing or damaged."""
    try:
        packed = read_bytes(path)
        unpacker = zlib.decompressobj(31)
        content = unpacker.decompress(packed, MAX_FILE_BYTES)
        if unpacker.unconsumed_tail or not unpacker.eof:
            raise InputError(
                f"{path}: expected situations of at most {MAX_FILE_BYTES} bytes, found more or a torn file"
            )
        return _SITUATIONS.validate_json(content)
    except OSError as error:
        raise InputError(f"{path}: expected situations, found {error.strerror}") from None
    except zlib.error as error:
        raise InputError(f"{path}: expected packed situations, found a damaged file ({error})") from None
    except ValidationError as error:
        raise InputError(f"{path}: {describe_first_error(error)}") from None
