"""Conditions under which agents were driven: places are given only among agents with the same ones."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mdrive_sumo.report.comparison_report.report_runs import ReportRun
from mdrive_sumo.runs.setting_differences import format_setting
from mdrive_sumo.v2x.comm_settings import PRESETS, describe_comm

CHANNEL, SEEDS = "channel", "seeds"
OFF = "off"
COMM = "comm "
"""Beginning of the names of settings of the channel."""


@dataclass(frozen=True, slots=True)
class DriveConditions:
    """The conditions of an agent's runs by name, as text; equal texts are equal conditions.

    They are settings of the drive and not of the agent: channel, clock, sensing, friction, ids, scripted actors, the
    second agent and its share, and the seeds.
    """

    values: Mapping[str, str]
    """Without the channel if the CAVs exchange nothing over it: then it cannot matter."""
    shared_channel: str = ""
    """The channel of the agents among which such an agent has its place."""

    @property
    def rank_group(self) -> str:
        """A text that is the same for agents that may be ranked together."""
        values = {CHANNEL: self.shared_channel, **self.values}
        return ", ".join(f"{name} {value}" for name, value in values.items())

    def format(self, names: Iterable[str]) -> list[str]:
        """Return those of these conditions, such as "sensing perfect"."""
        return [
            f"{'seed' if name == SEEDS and value.isdigit() else name} {value}"
            for name, value in self.values.items()
            if name in {*names}
        ]


def list_conditions(groups: Sequence[Sequence[ReportRun]]) -> list[DriveConditions]:
    """Return the conditions of each agent, given by its runs, which differ in seeds only."""
    values_by_group = [_list_own_conditions(runs) for runs in groups]
    channels = {values[CHANNEL] for values in values_by_group if CHANNEL in values} - {OFF}
    shared = channels.pop() if len(channels) == 1 else ""
    return [DriveConditions(values, shared) for values in values_by_group]


def find_differing_conditions(conditions: Sequence[DriveConditions]) -> tuple[str, ...]:
    """Return the names of the conditions that are not the same for all that have them, in their order."""
    names = dict.fromkeys(name for condition in conditions for name in condition.values)
    return tuple(
        name
        for name in names
        if len({condition.values[name] for condition in conditions if name in condition.values}) > 1
    )


def _list_own_conditions(runs: Sequence[ReportRun]) -> dict[str, str]:
    settings, info = runs[0].settings, runs[0].results.run
    seeds = sorted(seed for run in runs for seed in run.results.run.all_seeds)
    named = ("agent clock", *runs[0].results.run.conditions, "others", "penetration")
    return {
        **({} if _is_silent(runs) else {CHANNEL: describe_channel(info.comm)}),
        **{name: format_setting(settings.get(name)) for name in named},
        SEEDS: ", ".join(map(str, seeds)),
    }


def describe_channel(comm: Mapping[str, Any]) -> str:
    """Return a channel as text: off, a preset, or all that differs from the ideal one."""
    if not comm.get("on", True):
        return OFF
    preset = str(comm.get("preset", ""))
    if preset in PRESETS and {**comm} == describe_comm(PRESETS[preset]):
        return preset
    ideal = describe_comm(PRESETS["ideal"])
    changed = {name: value for name, value in comm.items() if name != "preset" and value != ideal.get(name)}
    return ", ".join(f"{name} {format_setting(value)}" for name, value in changed.items()) or "ideal"


def _is_silent(runs: Sequence[ReportRun]) -> bool:
    """Return whether the channel was on and no CAV exchanged anything over it."""
    is_on = all(run.results.run.comm.get("on", True) for run in runs)
    return is_on and not any(scenario.exchanged for run in runs for scenario in run.results.scenarios)
