"""JournaledTake: a simulation whose actions are in the journal before they take effect."""

from dataclasses import replace

from mdrive_sumo.runs.takes import HUMAN, RECORDING, Action, DriverChoice
from server.drive.worker.drive_context import DriveContext
from server.drive.worker.orders import TakeOrder
from server.drive.worker.take_journal import CavAction, TakeJournal, TickActions
from server.drive.worker.take_simulation import TakeSimulation


class JournaledTake:
    """A take from the tick of its order on."""

    def __init__(
        self, context: DriveContext, simulation: TakeSimulation, order: TakeOrder, journal: TakeJournal
    ) -> None:
        self.context, self.simulation, self.order = context, simulation, order
        self._journal = journal
        self.changes: dict[str, DriverChoice] = choose_drivers(context, simulation, order)
        """Drivers that begin in the current tick, by CAV."""

    @property
    def is_driven(self) -> bool:
        """Whether it has a tick of its own."""
        return self.simulation.tick > self.order.header.tick or self.simulation.is_done

    @property
    def left_tick(self) -> int | None:
        """The first tick in which people left a CAV; None: they have not."""
        return next((tick for tick, one in enumerate(self.simulation.log.ticks) if one.left), None)

    def find_driver(self, cav: str) -> str:
        """Return who drives a CAV in the current tick."""
        return self.changes[cav].name if cav in self.changes else self.simulation.find_driver(cav)

    def is_driven_by(self, cav: str, choice: DriverChoice) -> bool:
        """Return whether a CAV has this driver in the current tick, a person with the same device."""
        driver = self.changes.get(cav) or self.simulation.find_choice(cav)
        if driver is None or choice.name != HUMAN:
            return driver is not None and driver.name == choice.name
        return driver.name == HUMAN and driver.device == choice.device

    def list_people(self) -> list[str]:
        """Return the CAVs that people drive in the current tick."""
        return [cav for cav in self.simulation.driven_cavs if self.find_driver(cav) == HUMAN]

    def advance(self, actions: TickActions) -> None:
        """Append the actions of the current tick to the journal and advance by one tick.

        Raises OSError if they cannot be written; nothing has happened then. Raises WorldError.
        """
        actions = replace(actions, digest=self.simulation.episode.digest)
        self._journal.append(self.simulation.tick, actions)
        self.simulation.log.ticks.append(actions)
        self.changes = {}
        self.simulation.step()

    def compose_leaving(self) -> TickActions:
        """Return the actions of the tick in which people leave: their CAVs fail, the others drive on."""
        left = self.list_people()
        cavs = {cav: CavAction(Action(choice)) for cav, choice in self.changes.items() if cav not in left}
        return TickActions(cavs, tuple(left))

    def close(self) -> None:
        """Close the journal."""
        self._journal.close()


def choose_drivers(context: DriveContext, simulation: TakeSimulation, order: TakeOrder) -> dict[str, DriverChoice]:
    """Return the drivers that begin in the tick of an order, by CAV.

    In tick 0 that is every CAV, and after a recording, which drives in nothing that is not recorded. Where a drive
    enters a run, its people take over, and what other people drove there goes to agents.
    """
    changes: dict[str, DriverChoice] = {}
    for cav in simulation.driven_cavs:
        driver, is_person = simulation.find_driver(cav), cav in context.setup.people
        if driver in ("", RECORDING) or (order.people_take_over and (is_person or driver == HUMAN)):
            changes[cav] = context.choose_driver(cav)
    return changes
