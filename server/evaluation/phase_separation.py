"""Hidden and public work never at the same time on one host: what an agent learns of a hidden scenario has no way out.

The log of a public phase is shown to its team, so a box of a hidden phase must find no box of a public one beside it.
Each dispatcher holds a *mark*, an abstract socket of the host, while it runs jobs of a kind; it claims jobs of a kind
only where it has set the mark of this kind and found none of the other. The kernel removes the marks of a dead process.
When a turn is over and the next job in the queue is of the other kind, no more jobs of the present kind are claimed,
and a third mark asks the other dispatchers of this host to do the same.
"""

import logging
import os
import secrets
import socket
import weakref
from collections.abc import Callable
from contextlib import suppress
from hashlib import blake2b
from pathlib import Path
from typing import Literal

from sqlalchemy.orm import Session

from server.store import phases, submissions
from server.store.tables import JobRow

LOG = logging.getLogger("mdrive.worker")
TURN_US = 120 * 1_000_000
"""A kind of work keeps a host so long while it has jobs: a change costs the time of the longest running job [us]."""
MARKS = 1000
"""Dispatchers of one server on a host at most."""
SOCKETS = Path("/proc/net/unix")
CACHES = Path("/proc/sys/vm/drop_caches")

MOST_MOVED = 4096
"""Pipes and memory files that are made on each processor at a change of kind: 9 microseconds each, 18 ms on average."""

CLAIMED = "claimed"
"""Key of a job between its claim and the end of the transaction."""

Claim = Callable[[bool | None], JobRow | None]
"""Claims the next job of public phases (True), hidden ones (False), or any (None)."""


class PhaseSeparation:
    """What a dispatcher may run now. `kinds` are those of `[work] phase_kinds`."""

    def __init__(self, kinds: Literal["all", "hidden", "public"], data: Path, drop_caches: bool) -> None:
        """`data`: the server's data folder; servers with different ones do not know of each other."""
        self._fixed = {"all": None, "hidden": False, "public": True}[kinds]
        self._scope = blake2b(os.fsencode(data.absolute()), digest_size=8).hexdigest()
        self._drop_caches = drop_caches
        self._running: dict[str, bool] = {}
        self._marks: dict[str, int] = {}
        weakref.finalize(self, _close_marks, self._marks)
        self._kind: bool | None = None
        self._since_us = 0

    def claim(self, session: Session, claim: Claim, now_us: int) -> JobRow | None:
        """Claim a job that may run here now, noted as `CLAIMED` until `rename` or `end`."""
        present = self._find_present_kind()
        changing = present is not None and self._is_turn_over(present, now_us)
        with session.begin_nested() as savepoint:
            job = claim(self._fixed if self._fixed is not None or present is None or changing else present)
            if job is None:
                return None
            kind = phases.get(session, submissions.get(session, job.submission).phase).public
            if self.try_begin(CLAIMED, kind, now_us):
                return job
            savepoint.rollback()
        return None

    def try_begin(self, key: str, public: bool, now_us: int) -> bool:
        """Note that this work begins; False, and nothing noted, if work of the other kind runs on this host."""
        name = self._name("runs", public)
        own = self._marks[name] if name in self._marks else _bind(name)
        if own is None or self._is_marked(self._name("runs", not public)):
            if own is not None and name not in self._marks:
                os.close(own)
            self._ask_for(public)
            return False
        self._marks[name] = own
        self._running[key] = public
        if self._kind is not public:
            self._change_to(public, now_us)
        self._unmark(self._name("wants", public))
        return True

    def rename(self, key: str, new: str) -> None:
        """Note under which key the dispatcher holds what it has begun."""
        self._running[new] = self._running.pop(key)

    def end(self, key: str) -> None:
        """Note that this work has ended, or was never begun."""
        public = self._running.pop(key, None)
        if public is not None and public not in self._running.values():
            self._unmark(self._name("runs", public))

    def close(self) -> None:
        """Remove all marks."""
        _close_marks(self._marks)

    def _find_present_kind(self) -> bool | None:
        """Return the kind of work that runs on this host; None if there is none."""
        return next((kind for kind in (False, True) if self._is_marked(self._name("runs", kind))), None)

    def _is_turn_over(self, present: bool, now_us: int) -> bool:
        if self._kind is not present:  # others have begun it while this dispatcher was idle
            self._kind, self._since_us = present, now_us
        return now_us - self._since_us >= TURN_US or self._is_marked(self._name("wants", not present))

    def _change_to(self, public: bool, now_us: int) -> None:
        before, self._kind, self._since_us = self._kind, public, now_us
        if before is not None and self._drop_caches:
            drop_page_cache()
            move_inode_numbers()

    def _ask_for(self, public: bool) -> None:
        name = self._name("wants", public)
        if name not in self._marks and (mark := _bind(name)) is not None:
            self._marks[name] = mark

    def _unmark(self, name: str) -> None:
        if (mark := self._marks.pop(name, None)) is not None:
            os.close(mark)

    def _is_marked(self, name: str) -> bool:
        return f"@{name}-" in SOCKETS.read_text(errors="replace")

    def _name(self, what: str, public: bool) -> str:
        return f"mdrive-sumo-{what}-{'public' if public else 'hidden'}-{os.geteuid()}-{self._scope}"


def _close_marks(marks: dict[str, int]) -> None:
    while marks:
        os.close(marks.popitem()[1])


def _bind(name: str) -> int | None:
    """Return the descriptor of a mark of this name; None if all are taken."""
    for number in range(MARKS):
        mark = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            mark.bind(f"\0{name}-{number}")
        except OSError:
            mark.close()
        else:
            return mark.detach()
    return None


def drop_page_cache() -> bool:
    """Have the kernel forget the pages of files that nothing uses; return False where that is not permitted."""
    with suppress(OSError):
        CACHES.write_text("1\n")
        return True
    LOG.info("the page cache is not dropped between hidden and public work: only root may")
    return False


def move_inode_numbers() -> None:
    """Have the kernel give away a random amount of the numbers that it counts for all boxes.

    A second wall: boxes are not told these numbers (docs/sandbox-channels.md, Numbers that the kernel counts). The
    kernel takes them in batches for each processor.
    """
    before = os.sched_getaffinity(0)
    try:
        for processor in sorted(before):
            os.sched_setaffinity(0, {processor})
            for _ in range(secrets.randbelow(MOST_MOVED)):
                for end in (*os.pipe(), os.memfd_create("mdrive-sumo")):
                    os.close(end)
    finally:
        os.sched_setaffinity(0, before)


def describe_mixed_phases(kinds: str, publics: frozenset[bool]) -> str:
    """Return a warning if the workers of one machine take jobs of hidden and public phases; "" if not."""
    if kinds != "all" or len(publics) < 2:
        return ""
    return (
        "hidden and public phases share the workers of this machine, one kind at a time: for a challenge with prizes"
        " run the hidden ones on a machine of their own ([work] phase_kinds = 'hidden' there and 'public' here, see"
        " docs/server-phases.md)"
    )
