"""The plan of a study with persons at the wheel: `plan.yaml`, and `plan.json` in the study's folder."""

from collections.abc import Sequence
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from mdrive_sumo.core.suggestion import describe_unknown
from mdrive_sumo.runs.run_config import MAX_SEED
from mdrive_sumo.scenario.scenario_part import Identifier
from mdrive_sumo.scenario.season import read_stored_name

FORMAT = "mdrive-sumo/human-study-plan/1"
PERSON = "person"
"""Partner of a condition in which another participant drives the other CAV."""
MAX_PARTICIPANTS = 500
"""Chosen: more than any driving study that one host serves."""
MAX_TEXT = 20_000
"""Characters of a consent text: ten pages."""
Code = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,23}$")]
"""Of a participant: a code and never a name. It names a folder."""
ShortText = Annotated[str, Field(min_length=1, max_length=500)]
LongText = Annotated[str, Field(min_length=1, max_length=MAX_TEXT)]


def _check_unique(what: str, names: Sequence[str]) -> None:
    twice = next((name for place, name in enumerate(names) if name in names[:place]), None)
    if twice is not None:
        raise ValueError(f"{what}: expected each once, found {twice!r} twice")


class PlanPart(BaseModel):
    """Base of all parts of a plan: immutable, unknown keys are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True)

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown_keys(cls, data: Any) -> Any:
        if isinstance(data, dict):
            for key in data:
                if key not in cls.model_fields:
                    raise ValueError(describe_unknown(str(key), cls.model_fields))
        return data


def _read_scenario(data: object) -> object:
    return {"id": data} if isinstance(data, str) else data


class PlannedScenario(PlanPart):
    """A scenario of the plan, and which CAV a participant drives in it. A plain id means CAV 0."""

    id: Identifier
    """Id of a scenario of the plan's suite."""
    cav: Annotated[int, Field(ge=0, le=63)] = 0
    """Number of the CAV that the participant drives, in the order of the scenario file; the partner has the next."""


ScenarioEntry = Annotated[PlannedScenario, BeforeValidator(_read_scenario)]


class StudyCondition(PlanPart):
    """What a participant has in a drive."""

    name: Identifier
    """Name in results."""
    v2x_view: bool = True
    """Whether the drive page shows what V2X messages tell: shared objects and intentions."""
    chat: bool = False
    """Whether the participant can send text messages to other CAVs, and sees theirs."""
    partner: Annotated[str, Field(min_length=1, max_length=80)] = "sharing"
    """Built-in agent that drives all other CAVs, or `person`: the next participant drives the next CAV."""

    @property
    def has_person(self) -> bool:
        """Whether two participants drive together."""
        return self.partner == PERSON


class Practice(PlanPart):
    """Drives before those that count, so that participants know the controls."""

    scenarios: Annotated[tuple[ScenarioEntry, ...], Field(min_length=1, max_length=50)]
    """Driven in turn, again from the first one after the last one."""
    drives: Annotated[int, Field(ge=1, le=100)] | None = None
    """Number of practice drives; either this or `successes`."""
    successes: Annotated[int, Field(ge=1, le=50)] | None = None
    """Practice lasts until so many drives succeeded; either this or `drives`. The paper has ten in a row."""
    in_a_row: bool = True
    """Whether the successes must follow each other."""
    at_most: Annotated[int, Field(ge=1, le=200)] = 30
    """Practice with `successes` ends after so many drives in any case."""

    @model_validator(mode="after")
    def _check_ends(self) -> Self:
        if (self.drives is None) == (self.successes is None):
            found = "neither" if self.drives is None else "both"
            raise ValueError(f"expected either drives or successes, found {found}")
        if self.successes is not None and self.at_most < self.successes:
            raise ValueError(f"expected at_most of at least successes ({self.successes}), found {self.at_most}")
        return self


class QuestionBase(PlanPart):
    """What all items of a questionnaire have."""

    id: Identifier
    """Name of its column in the results."""
    text: ShortText
    """What the participant is asked."""
    optional: bool = False
    """Whether it may stay without an answer."""


class LikertQuestion(QuestionBase):
    """Agreement or rating on a scale from 1 to `points`."""

    kind: Literal["likert"]
    points: Annotated[int, Field(ge=2, le=11)] = 7
    low: ShortText = "strongly disagree"
    """What 1 means."""
    high: ShortText = "strongly agree"
    """What the highest number means."""


class NumberQuestion(QuestionBase):
    """A number between two bounds, e.g. a workload from 0 to 100."""

    kind: Literal["number"]
    least: float = 0.0
    most: float = 100.0
    unit: Annotated[str, Field(max_length=30)] = ""
    """Stands behind the field."""

    @model_validator(mode="after")
    def _check_bounds(self) -> Self:
        if self.least >= self.most:
            raise ValueError(f"expected least below most, found {self.least:g} and {self.most:g}")
        return self


class TextQuestion(QuestionBase):
    """Free text. The page asks to write nothing that tells who the participant is."""

    kind: Literal["text"]
    max_length: Annotated[int, Field(ge=1, le=4000)] = 1000
    """Characters of an answer."""


class ChoiceQuestion(QuestionBase):
    """One of several options."""

    kind: Literal["choice"]
    options: Annotated[tuple[ShortText, ...], Field(min_length=2, max_length=30)]

    @model_validator(mode="after")
    def _check_options(self) -> Self:
        _check_unique("options", self.options)
        return self


Question = Annotated[LikertQuestion | NumberQuestion | TextQuestion | ChoiceQuestion, Field(discriminator="kind")]
Questions = Annotated[tuple[Question, ...], Field(max_length=60)]


class Questionnaires(PlanPart):
    """Items after each drive that counts, and at the end."""

    after_drive: Questions = ()
    at_end: Questions = ()

    @model_validator(mode="after")
    def _check_ids(self) -> Self:
        for name, questions in (("after_drive", self.after_drive), ("at_end", self.at_end)):
            _check_unique(f"ids of {name}", [question.id for question in questions])
        return self


class Breaks(PlanPart):
    """Least pauses and the longest session. Defaults are those of the paper (ethics statement): sessions of under an
    hour, at least three hours before the next one."""

    between_drives_s: Annotated[float, Field(ge=0, le=3600)] = 20.0
    """Least pause between two drives [s]."""
    session_min: Annotated[float, Field(gt=0, le=240)] = 50.0
    """No drive begins later than this after the first one of a session [min]: 50 and a drive stay under an hour."""
    between_sessions_h: Annotated[float, Field(ge=0, le=240)] = 3.0
    """Least pause between the last drive of a session and the next session [h]."""


class HumanStudyPlan(PlanPart):
    """The whole plan."""

    format: Literal["mdrive-sumo/human-study-plan/1"] = FORMAT
    title: ShortText
    """Shown on every page."""
    welcome: Annotated[str, Field(max_length=MAX_TEXT)] = ""
    """Shown above the consent: what the study is about and what is asked of the participant."""
    consent: LongText
    """What a participant consents to. Nothing begins without consent."""
    contact: ShortText
    """How participants reach the organiser, also for a withdrawal: shown on every page."""
    participants: Annotated[int, Field(ge=1, le=MAX_PARTICIPANTS)] | tuple[Code, ...]
    """Number of participants, who get the codes P01, P02, ...; or their codes."""
    suite: Annotated[str, Field(min_length=1, max_length=400)] = "mdrive"
    """Name of a packaged suite, or a folder; without a season, season 0."""
    seed: Annotated[int, Field(ge=0, le=MAX_SEED)] = 0
    """Seed of all drives; 0: scenarios as written. All participants and agents meet the same traffic."""
    practice: Practice | None = None
    """Practice drives; none if absent."""
    scenarios: Annotated[tuple[ScenarioEntry, ...], Field(min_length=1, max_length=50)]
    """Scenarios of the drives that count."""
    conditions: Annotated[tuple[StudyCondition, ...], Field(min_length=1, max_length=12)]
    """Conditions of the drives that count."""
    order: Literal["crossed", "rotated"] = "crossed"
    """crossed: each participant drives every scenario in every condition. rotated: each scenario once, and over the
    participants every scenario equally often in each condition."""
    rewind: bool = False
    """Whether a participant may rewind a drive that counts; the last take then counts. Agents cannot rewind."""
    questionnaires: Questionnaires = Questionnaires()
    breaks: Breaks = Breaks()
    compare: Annotated[tuple[str, ...], Field(max_length=30)] = ("colmdriver-rule", "sharing", "sharing+negotiation")
    """Built-in agents that drive the same scenarios for the results."""

    @model_validator(mode="after")
    def _check_names(self) -> Self:
        _check_unique("scenarios", [scenario.id for scenario in self.scenarios])
        _check_unique("conditions", [condition.name for condition in self.conditions])
        _check_unique("compare", self.compare)
        if not isinstance(self.participants, int):
            if not 1 <= len(self.participants) <= MAX_PARTICIPANTS:
                raise ValueError(f"participants: expected 1 to {MAX_PARTICIPANTS}, found {len(self.participants)}")
            _check_unique("participants", [code.casefold() for code in self.participants])
        if self.has_pairs and len(self.codes) % 2:
            raise ValueError(
                f"participants: expected an even number, because a condition has partner: {PERSON}, found"
                f" {len(self.codes)}"
            )
        return self

    @property
    def suite_name(self) -> str:
        """What `load_suite` takes for the suite: a plan that names no season means season 0 for ever."""
        return read_stored_name(self.suite)

    @property
    def codes(self) -> tuple[str, ...]:
        """The codes of the participants, in the order in which they are assigned to orders."""
        if isinstance(self.participants, int):
            width = max(2, len(str(self.participants)))
            return tuple(f"P{number:0{width}}" for number in range(1, self.participants + 1))
        return self.participants

    @property
    def has_pairs(self) -> bool:
        """Whether participants drive in pairs in any condition."""
        return any(condition.has_person for condition in self.conditions)

    def find_partner(self, code: str) -> str:
        """Return the code of the participant who drives in a pair with another one; "" without pairs."""
        if not self.has_pairs:
            return ""
        return self.codes[self.codes.index(code) ^ 1]
