"""Figures of a report whose agents have long names."""

from testing.report_samples import BEST, SINGLE, make_agent_run

from mdrive_sumo.report.comparison_report.compared_agent import make_agents_of_results
from mdrive_sumo.report.comparison_report.comparison_report import build_comparison_report
from mdrive_sumo.report.comparison_report.report_figures import MAX_LINE, break_name


def test_long_names_leave_room_for_the_axes() -> None:
    """Matplotlib warns of axes without room, and warnings are errors here."""
    name = "my_agents/of_a_project.py:AgentOfAPaper (sensing perfect, friction wet, seeds 0, 1, 2)"
    runs = [make_agent_run(f"{name} {number}", scores) for number, scores in enumerate((BEST, SINGLE))]
    for figure in build_comparison_report(make_agents_of_results(runs)).figures:
        assert figure.render("svg")[0].startswith(b"<?xml")


def test_names_are_broken_between_words() -> None:
    assert break_name("sharing (channel ideal)") == "sharing (channel ideal)"
    lines = break_name("sharing+negotiation (sensing realistic, seed 0)").split("\n")
    assert lines == ["sharing+negotiation", "(sensing realistic, seed 0)"] and max(map(len, lines)) <= MAX_LINE
