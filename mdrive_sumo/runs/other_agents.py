"""OtherAgents: the agents of the CAVs that the agent under test does not drive (cross-play, partial penetration)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.core.setting import Scalar, list_settings, setting
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.scenario.scenario import Scenario

SINGLE = "single"
"""Drives the CAVs that are not connected: it neither sends nor reads messages."""


@dataclass(frozen=True, slots=True)
class OtherAgents:
    """A second agent in a run, and which share of the CAVs is left to the agent under test."""

    agent: AgentSpec = setting(
        key="others",
        metavar="AGENT",
        help="Agent of the CAVs that are not under test: --agent drives one CAV of each scenario, drawn by the seed, or"
        " as many as --penetration says [default with --penetration: single].",
    )
    penetration: int | None = setting(
        None,
        unit="percent",
        bounds=(1, 99),
        help="Share of the CAVs that --agent drives, at least one; the others drive as --others.",
    )
    """Percentage of the CAVs that the agent under test drives, rounded, at least one; None: exactly one."""

    def to_dict(self) -> dict[str, Scalar]:
        """Return the agent's name and the share as journals hold them. Raises InputError for no locator."""
        share = {} if self.penetration is None else {"penetration": self.penetration}
        return {"others": self.agent.resolve().name, **share}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "OtherAgents | None":
        """Return the second agent of a journal's fingerprint; None without one. Raises TypeError for a corrupt one."""
        penetration = values.get("penetration")
        if penetration is not None and type(penetration) is not int:
            raise TypeError(f"penetration: expected a value of type int, found {penetration!r:.60}")
        return cls(AgentSpec(values["others"]), penetration) if "others" in values else None

    def choose_tested(self, scenario: Scenario, seed: int) -> frozenset[str]:
        """Return the CAVs that the agent under test drives.

        They are drawn by the seed; with the same seed, a higher penetration keeps those of a lower one.
        """
        egos = sorted((ego.id for ego in scenario.egos), key=lambda ego: derive_seed(seed, "tested", scenario.id, ego))
        count = 1 if self.penetration is None else count_tested(len(egos), self.penetration)
        return frozenset(egos[:count])


_PENETRATION = next(one for one in list_settings(OtherAgents) if one.key == "penetration")


def count_tested(cavs: int, penetration: int) -> int:
    """Return how many of the CAVs a penetration [%] leaves to the agent under test: rounded half up, at least one."""
    return max(1, (2 * cavs * penetration + 100) // 200)


def parse_other_agents(others: str | None, penetration: int | None) -> OtherAgents | None:
    """Return the second agent of `--others` and `--penetration`; None without either. Raises InputError."""
    share: int | None = _PENETRATION.parse(penetration)
    if others is None and share is None:
        return None
    try:
        agent = AgentSpec(SINGLE if others is None else others)
    except InputError as error:
        raise InputError(f"others: {error}") from None
    return OtherAgents(agent, share)
