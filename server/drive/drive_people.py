"""DrivePeople: the drivers of one drive, which of them are there and ready, and how long it waits for a lost one."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.takes import HUMAN
from server.drive.browser_connection import POLICY_VIOLATION, BrowserConnection
from server.drive.messages import WaitingOut
from server.drive.protocol import InputDevice

SILENCE_S = 3.0
"""Time without a message after which a driver counts as absent [s]; the page sends one a second at least."""


@dataclass(slots=True)
class DriverSeat:
    """The place of the person who drives a CAV."""

    connection: BrowserConnection | None = None
    is_ready: bool = False
    """Whether `resume` was sent, and no `pause` since."""
    was_taken: bool = False
    """Whether a person has ever been there."""
    absent_until_s: float | None = None
    """When the time to come back ends; None: not absent, or it has ended."""
    stand_in: str = ""
    """The agent that drives until the lost driver is back."""

    device: InputDevice = InputDevice.KEYBOARD
    """Of the last input; takes begin with the keyboard."""
    noted_device: InputDevice | None = InputDevice.KEYBOARD
    """That which the take notes; None: not known, because it is a branch."""

    @property
    def device_name(self) -> str:
        """The device as takes note it, see `agents.human.DEVICES`."""
        return self.device.name.lower()

    @property
    def is_deserted(self) -> bool:
        """Whether its person has been there and has not come back in time."""
        return self.was_taken and self.connection is None and self.absent_until_s is None


class DrivePeople:
    """The drivers' seats of one drive, by CAV."""

    def __init__(self, cavs: Iterable[str], patience_s: float, clock: Callable[[], float]) -> None:
        """patience_s: how long the drive waits for a lost driver. clock: monotonic time [s]."""
        self.seats = {cav: DriverSeat() for cav in cavs}
        self._patience_s = patience_s
        self._clock = clock

    def take_seat(self, connection: BrowserConnection) -> bool:
        """Put a driver at the wheel of the connection's CAV; return whether one comes back.

        A connection that has said nothing for `SILENCE_S` makes room. Raises InputError if another driver is there.
        """
        seat = self.seats[connection.cav]
        before = seat.connection
        if before is not None and not before.is_closing:
            if self._clock() - before.heard_s < SILENCE_S:
                raise InputError(
                    f"{connection.cav}: expected a free seat, found a driver at the wheel; a spectator's link shows"
                    " the drive"
                )
            before.close(POLICY_VIOLATION, "the driver has connected anew")
        is_back = seat.was_taken
        seat.connection, seat.was_taken, seat.absent_until_s = connection, True, None
        return is_back

    def leave_seat(self, connection: BrowserConnection, *, for_good: bool) -> bool:
        """Note that a driver is gone; return False if the connection was at no wheel (any more).

        for_good: without time to come back.
        """
        seat = self.seats.get(connection.cav)
        if seat is None or seat.connection is not connection:
            return False
        seat.connection = None
        seat.absent_until_s = self._clock() + (0.0 if for_good else self._patience_s)
        return True

    def is_present(self, seat: DriverSeat) -> bool:
        """Return whether a driver is there and has been heard of lately."""
        return seat.connection is not None and self._clock() - seat.connection.heard_s < SILENCE_S

    def end_patience(self) -> list[str]:
        """Return the CAVs whose lost drivers' time to come back ends now; they must press start again."""
        late = [
            cav
            for cav, seat in self.seats.items()
            if seat.absent_until_s is not None and self._clock() >= seat.absent_until_s
        ]
        for cav in late:
            seat = self.seats[cav]
            seat.absent_until_s, seat.is_ready, seat.stand_in = None, False, ""
        return late

    def forget_readiness(self) -> None:
        """Let the clock wait until every driver presses start again."""
        for seat in self.seats.values():
            seat.is_ready = False

    def list_awaited(self, driver_by_cav: Mapping[str, str]) -> list[str]:
        """Return for which CAVs' drivers the clock waits: those at the wheel who are absent, all who are not ready."""
        return [
            cav
            for cav, seat in self.seats.items()
            if (driver_by_cav.get(cav) == HUMAN and not (self.is_present(seat) and seat.is_ready))
            or (seat.connection is not None and not seat.is_ready)
        ]

    def describe_wait(self, awaited: Iterable[str]) -> WaitingOut:
        """Return what the browsers are told of it."""
        seats = {cav: self.seats[cav] for cav in awaited}
        limits = [seat.absent_until_s for seat in seats.values() if seat.absent_until_s is not None]
        return WaitingOut(
            waits_for=[*seats],
            absent=[cav for cav, seat in seats.items() if not self.is_present(seat)],
            seconds=max(0.0, round(min(limits) - self._clock())) if limits else None,
        )
