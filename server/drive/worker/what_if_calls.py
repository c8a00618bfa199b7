"""WhatIfCalls: the calls of `what_if` that go on, and their branches, some of which run at a time."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace

from server.drive.simulation_values import WhatIfBranch
from server.drive.worker.child import Child, ChildProcesses
from server.drive.worker.orders import TakeMode, TakeOrder, WhatIfDone


class _WhatIfCall:
    """The agents that wait, and the branches that are done."""

    def __init__(self, agents: Sequence[str]) -> None:
        self.waiting = deque(enumerate(agents))
        self.branches: list[WhatIfBranch | None] = [None] * len(agents)

    @property
    def result(self) -> list[WhatIfBranch] | None:
        """The branches in the order of the agents; None while one is missing."""
        branches = [branch for branch in self.branches if branch is not None]
        return branches if len(branches) == len(self.branches) else None


class WhatIfCalls:
    """Branches of what-if calls, by the number of the call."""

    def __init__(self, children: ChildProcesses, slots: int, start: Callable[[TakeOrder], Child]) -> None:
        """slots: branches of a call that run at a time. start: starts a process for an order."""
        self._children, self._slots, self._start = children, slots, start
        self._calls: dict[int, _WhatIfCall] = {}

    def add(self, number: int, agents: Sequence[str]) -> None:
        """Begin a call, whose branches `go_on` starts."""
        self._calls[number] = _WhatIfCall(agents)

    def drop(self, number: int) -> None:
        """Forget a call that failed, or any other."""
        self._calls.pop(number, None)

    def go_on(self, number: int, order: TakeOrder) -> None:
        """Start branches of a call, as many at a time as there are slots. order: where they begin."""
        call = self._calls.get(number)
        busy = sum(number in child.calls for child in self._children)
        while call is not None and call.waiting and busy < self._slots:
            place, agent = call.waiting.popleft()
            branch = replace(order, mode=TakeMode.WHAT_IF, agent=agent, place=place)
            self._start(branch).calls[number] = "what_if"
            busy += 1

    def hear_checkpoint(self, child: Child, tick: int) -> None:
        """Begin the branches of the calls that have waited for a checkpoint in this tick."""
        order = child.order
        if order is not None and order.mode is TakeMode.HOLD and tick == order.header.tick:
            calls, child.calls = child.calls, {}
            for number in calls:
                self.go_on(number, order)

    def hear(self, child: Child, message: WhatIfDone) -> list[tuple[int, list[WhatIfBranch]]]:
        """Keep a branch; return the calls that are complete, with their branches."""
        complete: list[tuple[int, list[WhatIfBranch]]] = []
        numbers, order = set(child.calls), child.order
        assert order is not None, "a branch has an order"
        child.calls.clear()
        for number in numbers & set(self._calls):
            call = self._calls[number]
            call.branches[order.place] = message.branch
            if call.result is not None:
                complete.append((number, call.result))
                del self._calls[number]
            else:
                self.go_on(number, order)
        return complete
