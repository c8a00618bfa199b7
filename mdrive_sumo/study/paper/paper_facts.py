"""The facts that the study's pages begin with: what was measured with what."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from mdrive_sumo.study.paper.paper_numbers import PaperNumbers
from mdrive_sumo.study.paper.paper_plan import LOG_BUCKET, PaperScale

QUICK = "QUICK"
QUICK_WARNING = (
    f"{QUICK}: a few scenarios of every kind, to see what comes out. These numbers are no results:"
    " run the study without --quick for them."
)
CHOICES: Mapping[PaperScale, str] = MappingProxyType(
    {
        PaperScale.QUICK: "one of each InterDrive group and interactivity level, and two logs",
        PaperScale.STANDARD: "a quarter of each category, and five or more of each InterDrive group and level",
        PaperScale.WHOLE: "all of the suite",
    }
)


@dataclass(frozen=True, slots=True)
class PaperRequest:
    """The study as the user asked for it, and what could not be part of it."""

    command: Sequence[str]
    left_out: Mapping[str, str]
    """Why built-in agents are left out, by agent."""


def list_paper_facts(numbers: PaperNumbers, request: PaperRequest) -> dict[str, str]:
    """Return what was measured with what, by name."""
    run = numbers.compared[0].results.run
    plan = numbers.plan
    logs = LOG_BUCKET if any(one.bucket == LOG_BUCKET for one in numbers.scenarios) else "every bucket"
    options = ", ".join(f"{name} {value}" for name, value in run.conditions.items())
    return {
        "suite": f"{run.suite}, checksum {run.suite_checksum}",
        "scenarios": f"{len(plan.closed)}: {CHOICES[plan.scale]}",
        "open loop (RQ3)": f"{logs}: {len(plan.logs)} scenarios",
        "worse channels (RQ5)": f"{logs}: {len(plan.channel)} scenarios with two CAVs or more, evenly spaced in the"
        f" order of the suite: {', '.join(plan.channel)}",
        "seeds": ", ".join(map(str, run.all_seeds)),
        "agents": ", ".join(numbers.closed),
        "score mode": run.score_mode,
        "options": f"{options}, agent clock {run.agent_clock}",
        "command": shlex.join(request.command),
        "versions": ", ".join(f"{name} {version}" for name, version in sorted(run.versions.items())),
    }


def list_paper_warnings(numbers: PaperNumbers, request: PaperRequest) -> tuple[str, ...]:
    """Return what a reader must know before the numbers."""
    void = sum(one.void for one in numbers.runs)
    found = [QUICK_WARNING] if numbers.plan.scale is PaperScale.QUICK else []
    found += [f"Left out: {name}: {why}." for name, why in request.left_out.items()]
    found += [f"{void} episodes are void: a failure of the benchmark or of SUMO, not of an agent."] if void else []
    return tuple(found)
