"""Places for boxes on this host: one user id each, never two boxes at a time."""

import errno
import os
import socket
from dataclasses import dataclass

from mdrive_sumo.agent_process.sandbox.box_spec import SLOTS
from mdrive_sumo.core.errors import InputError

FIRST_UID = 60001
"""Above the users that Debian creates (to 59999); with all slots below the user without rights (65534)."""


@dataclass(frozen=True, slots=True)
class UserSlot:
    """A place taken by this process."""

    number: int
    lock: socket.socket
    """Bound to a name that only one process of the host can have; the kernel frees it when that process ends."""

    @property
    def uid(self) -> int | None:
        """User of the box; None where this process may not change its user."""
        return FIRST_UID + self.number if os.geteuid() == 0 else None

    def release(self, clean: bool) -> None:
        """Frees the place; one that could not be cleaned stays taken until this process ends."""
        if clean:
            self.lock.close()
        else:
            self.lock.detach()


def take_slot(number: int | None) -> UserSlot:
    """This slot, or the first that is free. Raises InputError if it is taken by a living box."""
    for candidate in range(SLOTS) if number is None else (number,):
        lock = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            lock.bind(f"\0mdrive-sumo-slot-{os.geteuid()}-{candidate}")
        except OSError as error:
            lock.close()
            if error.errno != errno.EADDRINUSE:
                raise
        else:
            return UserSlot(candidate, lock)
    which = f"slot {number}" if number is not None else f"one of {SLOTS} slots"
    raise InputError(f"sandbox: expected {which} to be free on this host, found a box in it")
