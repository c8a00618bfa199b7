"""Which drives each participant has, and in which order."""

from dataclasses import dataclass

from mdrive_sumo.study.human.human_study_plan import HumanStudyPlan, PlannedScenario, StudyCondition
from mdrive_sumo.study.human.latin_square import build_latin_square, order_items


@dataclass(frozen=True, slots=True)
class PlannedDrive:
    """A drive that counts."""

    number: int
    """Place in the participant's order, from 0."""
    scenario: PlannedScenario
    condition: StudyCondition
    cav: int
    """Number of the CAV that the participant drives."""

    @property
    def partner_cav(self) -> int:
        """Number of the CAV that the partner drives, where that is a person."""
        return self.scenario.cav + (1 if self.cav == self.scenario.cav else 0)

    @property
    def name(self) -> str:
        """Name of the drive's folder."""
        return f"{self.number:02}-{self.scenario.id}"


def find_row(plan: HumanStudyPlan, code: str) -> int:
    """Return the number of the order that a participant has; both of a pair have the same."""
    return plan.codes.index(code) // (2 if plan.has_pairs else 1)


def plan_drives(plan: HumanStudyPlan, code: str) -> tuple[PlannedDrive, ...]:
    """Return the drives of a participant, in blocks of one condition each.

    The order of the conditions is a row of their balanced Latin square, that of the scenarios within a block a row of
    theirs. `crossed`: every block has all scenarios, in another row each. `rotated`: the scenarios are dealt to the
    conditions, one place further with every participant.
    """
    row = find_row(plan, code)
    conditions = order_items(plan.conditions, row)
    drives: list[PlannedDrive] = []
    for block, condition in enumerate(conditions):
        for scenario in _choose_scenarios(plan, row, block, condition):
            cav = scenario.cav + (1 if condition.has_person and plan.codes.index(code) % 2 else 0)
            drives.append(PlannedDrive(len(drives), scenario, condition, cav))
    return tuple(drives)


def _choose_scenarios(
    plan: HumanStudyPlan, row: int, block: int, condition: StudyCondition
) -> tuple[PlannedScenario, ...]:
    if plan.order == "crossed":
        # One row further each time that all orders of conditions are done, or the two orders would always be paired.
        rounds = row // len(build_latin_square(len(plan.conditions)))
        return order_items(plan.scenarios, row + rounds + block)
    count, place = len(plan.conditions), plan.conditions.index(condition)
    dealt = [scenario for j, scenario in enumerate(plan.scenarios) if (j + row) % count == place]
    return order_items(dealt, row) if dealt else ()
