"""Plans: what is read, and one clear sentence for everything else."""

import json
from importlib import resources
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.human_study import FIRST, PAIRED, PLAN, make_plan

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.study.human.human_study_plan import HumanStudyPlan
from mdrive_sumo.study.human.plan_file import check_plan, load_plan

EXAMPLE = Path(str(resources.files("server.drive.study"))) / "examples" / "rq4.yaml"
LIKERT = {"id": "a", "kind": "likert", "text": "Good?"}


def load(tmp_path: Path, **changes: Any) -> HumanStudyPlan:
    path = tmp_path / "plan.json"
    path.write_text(json.dumps(PLAN | changes))
    plan = load_plan(path)
    check_plan(plan, "plan.json")
    return plan


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"colour": 1}, "expected one of format, title, .* found 'colour'"),
        ({"conditions": [{"name": "a", "fog": True}]}, "conditions.0: expected one of name, v2x_view, chat, partner,"),
        ({"conditions": [{"name": "a", "v2x_vew": True}]}, "found 'v2x_vew'; did you mean 'v2x_view'"),
        ({"conditions": [{"name": "a"}, {"name": "a"}]}, "conditions: expected each once, found 'a' twice"),
        ({"conditions": []}, "conditions: .* at least 1 item"),
        ({"conditions": [{"name": "a", "partner": "shring"}]}, "conditions: a: partner: .* did you mean 'sharing'"),
        ({"conditions": [{"name": "a", "partner": "colmdriver"}]}, "drives in real time, found 'colmdriver'"),
        ({"conditions": [{"name": "a", "partner": "human"}]}, "partner: expected one of .* or person, found 'human'"),
        ({"conditions": PAIRED, "participants": 3}, "expected an even number, because a condition has partner"),
        (
            {"conditions": PAIRED, "participants": 2, "scenarios": [{"id": FIRST, "cav": 1}]},
            "together: partner: expected a CAV after cav 1 for the partner, found i01_.* with 2",
        ),
        ({"scenarios": ["i01_ins_c_main_street_rigt"]}, "scenarios: .* did you mean 'i01_ins_c_main_street_right'"),
        ({"scenarios": [FIRST, FIRST]}, f"scenarios: expected each once, found '{FIRST}' twice"),
        ({"scenarios": [{"id": FIRST, "cav": 2}]}, "expected a cav from 0 to 1, found 2"),
        ({"scenarios": []}, "scenarios: .* at least 1 item"),
        ({"suite": "nowhere"}, "nowhere"),
        ({"participants": 0}, "participants"),
        ({"participants": ["P1", "p1"]}, "participants: expected each once, found 'p1' twice"),
        ({"participants": ["Jane Doe"]}, "participants"),
        ({"participants": []}, "participants: expected 1 to 500, found 0"),
        ({"practice": {"scenarios": [FIRST]}}, "practice: expected either drives or successes, found neither"),
        ({"practice": {"scenarios": [FIRST], "drives": 1, "successes": 1}}, "drives or successes, found both"),
        ({"practice": {"scenarios": [FIRST], "successes": 9, "at_most": 3}}, "at_most of at least successes"),
        ({"practice": {"scenarios": ["i99"], "drives": 1}}, "practice: expected ids of the suite interdrive"),
        ({"questionnaires": {"after_drive": [LIKERT, LIKERT]}}, "ids of after_drive: expected each once, found 'a'"),
        ({"questionnaires": {"at_end": [LIKERT | {"kind": "stars"}]}}, "questionnaires.at_end.0"),
        ({"questionnaires": {"at_end": [LIKERT | {"points": 1}]}}, "points"),
        (
            {"questionnaires": {"at_end": [{"id": "n", "kind": "number", "text": "?", "least": 2, "most": 1}]}},
            "expected least below most, found 2 and 1",
        ),
        (
            {"questionnaires": {"at_end": [{"id": "c", "kind": "choice", "text": "?", "options": ["x", "x"]}]}},
            "options: expected each once, found 'x' twice",
        ),
        ({"breaks": {"session_min": 0}}, "breaks.session_min"),
        ({"breaks": {"between_drives_s": "soon"}}, "breaks.between_drives_s"),
        ({"compare": ["idm", "idm"]}, "compare: expected each once"),
        ({"compare": ["nobody"]}, "compare: expected one of"),
        ({"seed": -1}, "seed"),
        ({"consent": ""}, "consent"),
        ({"order": "random"}, "order"),
        ({"format": "mdrive-sumo/human-study-plan/9"}, "format"),
    ],
)
def test_every_fault_of_a_plan_is_one_sentence(tmp_path: Path, changes: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence) as caught:
        load(tmp_path, **changes)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "expected the keys of a plan .* found nothing"),
        ("- a\n- b\n", "expected the keys of a plan .* found a list"),
        ("title: [", "expected YAML, found a fault in line 2"),
        ("title: a\ntitle: b\n", "fault in line 2: the key 'title' stands twice"),
        ("a: &x [1]\nb: *x\n", r"expected no aliases, found \*x"),
        ("a: " + "[" * 20 + "]" * 20, "expected at most 12 levels"),
        ("a: !!python/object/apply:os.system ['true']\n", "expected YAML, found a fault"),
        ("a: 2026-13-45\n", "found a value that cannot be read"),
        ("a: \x07\n", "expected YAML, found a fault"),
    ],
)
def test_every_fault_of_a_yaml_file_is_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "plan.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=sentence) as caught:
        load_plan(path)
    assert "\n" not in str(caught.value)


def test_files_that_cannot_be_read_are_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read: No such file"):
        load_plan(tmp_path / "absent.yaml")
    (tmp_path / "latin.yaml").write_bytes(b"title: \xe4")
    with pytest.raises(InputError, match="expected text in UTF-8"):
        load_plan(tmp_path / "latin.yaml")
    (tmp_path / "plan.json").write_text("{")
    with pytest.raises(InputError, match="expected JSON"):
        load_plan(tmp_path / "plan.json")


@given(st.text(st.characters(codec="utf-8"), max_size=80))
def test_any_text_is_a_plan_or_one_sentence(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    path = tmp_path_factory.getbasetemp() / "any.yaml"
    path.write_text(text, "utf-8")
    with pytest.raises(InputError):
        load_plan(path)


def test_the_packaged_example_is_sound_and_as_the_paper_asks() -> None:
    plan = load_plan(EXAMPLE)
    suite = check_plan(plan, str(EXAMPLE))
    assert plan.breaks.session_min < 60 and plan.breaks.between_sessions_h >= 3
    assert plan.practice is not None and plan.practice.in_a_row
    assert len(plan.scenarios) >= 10  # fewer give no interval
    assert {scenario.bucket for scenario in suite if scenario.id in {one.id for one in plan.scenarios}} == {
        "InterDrive",
        "Interaction",
        "V2XPnP",
    }


def test_codes_are_numbered_or_given() -> None:
    assert make_plan(participants=3).codes == ("P01", "P02", "P03")
    assert make_plan(participants=120).codes[-1] == "P120"
    assert make_plan(participants=["x-1", "y_2"]).codes == ("x-1", "y_2")


def test_a_plan_survives_its_own_json() -> None:
    plan = make_plan(conditions=PAIRED, practice={"scenarios": [FIRST], "successes": 2})
    assert HumanStudyPlan.model_validate_json(plan.model_dump_json()) == plan
