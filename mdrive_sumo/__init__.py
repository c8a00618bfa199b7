"""The MDrive closed-loop cooperative-driving benchmark on Eclipse SUMO.

    import mdrive_sumo as md

    suite = md.load_suite("interdrive@0")
    run = md.evaluate(suite, agent="sharing", comm="realistic", workers=2)
    episode = md.simulate("i11_ins_sl_town", agent="sharing", seed=0)

A name is imported when it is first used, so `import mdrive_sumo` itself loads nothing: the command line and the child
processes of agents stay light.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mdrive_sumo import worlds
    from mdrive_sumo.api.episode import Episode, load_episode
    from mdrive_sumo.api.evaluation import evaluate
    from mdrive_sumo.api.open_evaluation import evaluate_open
    from mdrive_sumo.api.report import RunsReport, build_report
    from mdrive_sumo.api.run import Run, Scores, compare, load_run
    from mdrive_sumo.api.simulation import Simulation, simulate
    from mdrive_sumo.contract import Agent, Briefing, Control, Message, Note, Observation, Plan, Reply, SensorSpec
    from mdrive_sumo.core.errors import InputError, MdriveError, WorldError
    from mdrive_sumo.core.version import __version__ as __version__
    from mdrive_sumo.loop.agent_driver import AgentFailure
    from mdrive_sumo.open_loop.results import OpenLoopResults
    from mdrive_sumo.report.replay_page import ReplayPage
    from mdrive_sumo.runs.compare import RunComparison
    from mdrive_sumo.scenario.packaged_suites import list_suites
    from mdrive_sumo.scenario.scenario import Scenario
    from mdrive_sumo.scenario.suite import Suite, load_suite

__all__ = [
    # scenarios
    "Scenario",
    "Suite",
    "list_suites",
    "load_suite",
    "worlds",
    # driving
    "Simulation",
    "evaluate",
    "evaluate_open",
    "simulate",
    # results
    "OpenLoopResults",
    "RunComparison",
    "Episode",
    "ReplayPage",
    "Run",
    "RunsReport",
    "Scores",
    "build_report",
    "compare",
    "load_episode",
    "load_run",
    # what an agent exchanges with the benchmark
    "Agent",
    "Briefing",
    "Control",
    "Message",
    "Note",
    "Observation",
    "Plan",
    "Reply",
    "SensorSpec",
    # errors
    "AgentFailure",
    "InputError",
    "MdriveError",
    "WorldError",
]

_MODULE_BY_NAME = {
    "Scenario": "scenario.scenario",
    "Suite": "scenario.suite",
    "list_suites": "scenario.packaged_suites",
    "load_suite": "scenario.suite",
    "Simulation": "api.simulation",
    "evaluate": "api.evaluation",
    "evaluate_open": "api.open_evaluation",
    "OpenLoopResults": "open_loop.results",
    "simulate": "api.simulation",
    "RunComparison": "runs.compare",
    "Episode": "api.episode",
    "ReplayPage": "report.replay_page",
    "Run": "api.run",
    "RunsReport": "api.report",
    "Scores": "api.run",
    "build_report": "api.report",
    "compare": "api.run",
    "load_episode": "api.episode",
    "load_run": "api.run",
    **dict.fromkeys(
        ("Agent", "Briefing", "Control", "Message", "Note", "Observation", "Plan", "Reply", "SensorSpec"), "contract"
    ),
    "AgentFailure": "loop.agent_driver",
    **dict.fromkeys(("InputError", "MdriveError", "WorldError"), "core.errors"),
    "__version__": "core.version",
}

_ROOMS = ("worlds",)
"""Packages whose names are used with theirs in front: `md.worlds.load`."""


def __getattr__(name: str) -> Any:
    """Import a public name on first use (PEP 562)."""
    if name not in _MODULE_BY_NAME and name not in _ROOMS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    if name in _ROOMS:
        return import_module(f"{__name__}.{name}")
    value = getattr(import_module(f"{__name__}.{_MODULE_BY_NAME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
