"""`paper.md`: the study as a page, and the facts that every page of it shows."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mdrive_sumo.core.tables import escape_markdown, format_markdown_table
from mdrive_sumo.loop import EpisodeOptions
from mdrive_sumo.report.comparison_report.table_markdown import MARKS_LEGEND, format_markdown, has_marks
from mdrive_sumo.study.paper.paper_numbers import PaperNumbers
from mdrive_sumo.study.paper.paper_plan import LOG_BUCKET
from mdrive_sumo.study.paper.paper_sections import QUICK, PaperSection
from mdrive_sumo.study.paper.section_texts import NO_COUNTERPART, SectionText

TITLE = "The paper's tables and figures, measured with mdrive-sumo"
QUICK_WARNING = (
    f"{QUICK}: a few scenarios of every kind, to see what comes out. These numbers are no results:"
    " run the study without --quick for them."
)
NO_COUNTERPART_HEADER = ("of the paper", "why the study has no counterpart")


@dataclass(frozen=True, slots=True)
class PaperRequest:
    """The study as the user asked for it, and what could not be part of it."""

    command: Sequence[str]
    left_out: Mapping[str, str]
    """Why built-in agents are left out, by agent."""


def describe_facts(numbers: PaperNumbers, request: PaperRequest) -> dict[str, str]:
    """Return what was measured with what, by name."""
    run = numbers.compared[0].results.run
    plan = numbers.plan
    kind = "one of each InterDrive group and interactivity level, and logs" if plan.quick else "all of the suite"
    logs = LOG_BUCKET if any(one.bucket == LOG_BUCKET for one in numbers.scenarios) else "every bucket"
    options = ", ".join(f"{key} {getattr(run, key)}" for key in EpisodeOptions.list_choices())
    return {
        "suite": f"{run.suite}, checksum {run.suite_checksum}",
        "scenarios": f"{len(plan.closed)} ({kind})",
        "open loop (RQ3)": f"{len(plan.logs)} scenarios of {logs}",
        "worse channels (RQ5)": f"{len(plan.channel)} scenarios of {logs} with two CAVs or more, evenly spaced in the"
        f" order of the suite: {', '.join(plan.channel)}",
        "seeds": ", ".join(map(str, run.all_seeds)),
        "agents": ", ".join(numbers.closed),
        "left out": "; ".join(f"{name}: {why}" for name, why in request.left_out.items()) or "none",
        "void episodes": str(sum(one.void for one in numbers.runs)),
        "score mode": run.score_mode,
        "options": f"{options}, agent clock {run.agent_clock}",
        "command": shlex.join(request.command),
        "versions": ", ".join(f"{name} {version}" for name, version in sorted(run.versions.items())),
    }


def build_markdown_page(numbers: PaperNumbers, sections: Sequence[PaperSection], request: PaperRequest) -> str:
    """Return the study as Markdown."""
    parts = [
        f"# {TITLE}",
        f"**{QUICK_WARNING}**" if numbers.plan.quick else "",
        "\n".join(f"- {name}: {escape_markdown(value)}" for name, value in describe_facts(numbers, request).items()),
    ]
    for section in sections:
        parts += [f"## {section.text.title}", _format_text(section.text)]
        parts += [f"![{figure}]({figure}.png)" for figure in section.figures]
        for table in section.tables:
            legend = f" {MARKS_LEGEND}" if has_marks(table) else ""
            parts += [f"### {table.title}", format_markdown(table), escape_markdown(table.note) + legend]
    parts += ["## Without a counterpart", format_markdown_table(NO_COUNTERPART_HEADER, NO_COUNTERPART.items(), left=2)]
    return "\n\n".join(part for part in parts if part) + "\n"


def list_texts(text: SectionText) -> dict[str, str]:
    """Return the words of a section by what they say, without empty ones."""
    found = {
        "Counterpart of": text.counterpart,
        "The paper": text.claim,
        "Comparable to CARLA": text.comparable,
        "Not comparable": text.not_comparable,
    }
    return {name: words for name, words in found.items() if words}


def _format_text(text: SectionText) -> str:
    return "\n".join(f"- **{name}**: {escape_markdown(words)}" for name, words in list_texts(text).items())
