"""WhatIfCall: the branches of one `what_if`, some of which run at a time."""

from collections import deque
from collections.abc import Sequence

from server.drive.simulation_values import WhatIfBranch


class WhatIfCall:
    """The agents that wait, and the branches that are done."""

    def __init__(self, agents: Sequence[str]) -> None:
        self._waiting = deque(enumerate(agents))
        self._branches: list[WhatIfBranch | None] = [None] * len(agents)

    def take_next(self) -> tuple[int, str] | None:
        """Return the next agent and its place, None if none waits."""
        return self._waiting.popleft() if self._waiting else None

    def add(self, place: int, branch: WhatIfBranch) -> None:
        """Keep a branch."""
        self._branches[place] = branch

    @property
    def result(self) -> list[WhatIfBranch] | None:
        """The branches in the order of the agents; None while one is missing."""
        branches = [branch for branch in self._branches if branch is not None]
        return branches if len(branches) == len(self._branches) else None
