"""What a run was made of, as a list of names and values: agent, checksums, seeds, versions, settings."""

import json
import shlex
from collections.abc import Iterator, Mapping
from typing import Any

from mdrive_sumo.report.result_tables import describe_agent
from mdrive_sumo.scoring import Results

Fact = tuple[str, str]
CHECKSUMS = {"code": "checksum of mdrive-sumo's code", "networks": "checksum of the networks"}


def list_provenance(results: Results, fingerprint: Mapping[str, Any]) -> tuple[Fact, ...]:
    """Return what a reader needs to repeat or to judge a run. fingerprint: of its journal."""
    return tuple((name, value) for name, value in _list_facts(results, fingerprint) if value)


def _list_facts(results: Results, fingerprint: Mapping[str, Any]) -> Iterator[Fact]:
    run = results.run
    yield "agent", describe_agent(results)
    yield "options of the agent", _format_options(fingerprint.get("agent_config")) or run.agent_config
    yield "checksum of the agent's code", str(fingerprint.get("agent_code", ""))
    yield "says of itself", run.declared_label
    yield "suite", run.suite_label
    yield "checksum of the suite", run.suite_checksum
    yield "seeds" if len(run.all_seeds) > 1 else "seed", ", ".join(map(str, run.all_seeds))
    yield "score mode", run.score_mode
    for name, value in run.shown_conditions.items():
        yield name, str(value)
    yield "agent clock", run.agent_clock
    yield "channel", ", ".join(f"{name} {_format(value)}" for name, value in run.comm.items())
    yield "sandbox", "yes" if fingerprint.get("sandbox") else "no"
    yield "versions", ", ".join(f"{name} {version}" for name, version in sorted(run.versions.items()))
    for name, label in CHECKSUMS.items():
        yield label, str(fingerprint.get(name, ""))
    yield "command", shlex.join(run.command)


def _format_options(text: object) -> str:
    try:
        options = json.loads(text) if isinstance(text, str) else None
    except (ValueError, RecursionError):
        return ""
    if not isinstance(options, dict):
        return ""
    return ", ".join(f"{name} {_format(value)}" for name, value in sorted(options.items()))


def _format(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
