"""Proposals by language model: a local service that answers well, badly or not at all; examples, repairs, replays."""

import json
import random
import socket
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, get_args

import pytest
from testing.negotiation_fakes import Answering, completion, served

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate.category_requirements import CATEGORIES, Category
from mdrive_sumo.generate.llm_answer import load_demonstrations, parse_proposal
from mdrive_sumo.generate.llm_prompt import RULES_IN_WORDS, TERMS, build_prompt
from mdrive_sumo.generate.llm_proposer import LlmSettings, propose, transcript_path
from mdrive_sumo.generate.proposal import ConstraintType, Proposal
from mdrive_sumo.generate.recipe import Recipe
from mdrive_sumo.generate.rejection import PipelineStage, ProposalRejected
from mdrive_sumo.generate.rules import RULES
from mdrive_sumo.generate.template_proposer import propose as from_template
from mdrive_sumo.scenario.categories import LEVELS

pytestmark = pytest.mark.slow

CROSSWALK, DEADLOCK = Category.CROSSWALK, Category.DEADLOCK
CATEGORY_LIST = list(Category)


def good(category: Category = CROSSWALK, seed: int = 5) -> Proposal:
    return from_template(category, random.Random(seed))


def broken(**changes: Any) -> str:
    return json.dumps(good().model_dump(mode="json") | changes)


def saying(*texts: str) -> Answering:
    """A model that says these texts one after the other, the last one for ever."""
    left = list(texts)
    return lambda request: (200, completion(left.pop(0) if len(left) > 1 else left[0]))


def settings_for(url: str, **more: Any) -> LlmSettings:
    return LlmSettings(**({"endpoint": url, "timeout_s": 30.0} | more))


def entries(folder: Path, seed: str = "7", category: Category = CROSSWALK) -> list[dict[str, Any]]:
    return [json.loads(line) for line in transcript_path(folder, category, seed).read_text().splitlines()]


@pytest.mark.parametrize(
    "around",
    ["{}", "```json\n{}\n```", "Here it is:\n```\n{}\n```\nIt fits.", "<think>I could say {{}} or }}.</think>\n{}"],
)
def test_a_good_answer_is_the_proposal_whatever_stands_around_it(around: str) -> None:
    with served(saying(around.format(good().model_dump_json(indent=4)))) as service:
        assert propose(CROSSWALK, "7", settings_for(service.url)) == good()
    assert len(service.requests) == 1
    assert "Authorization" not in service.headers


def test_what_was_wrong_is_told_and_repaired(tmp_path: Path) -> None:
    answers = (broken(topology="motorway", surprise=1), broken(actors=[]), good().model_dump_json())
    with served(saying(*answers)) as service:
        assert propose(CROSSWALK, "7", settings_for(service.url, transcripts=tmp_path)) == good()
    first, second, third = (request["messages"] for request in service.requests)
    assert len(first) == 2
    assert second[:2] == first and second[2] == {"role": "assistant", "content": answers[0]}
    assert "topology: Input should be" in second[3]["content"] and "surprise: Extra inputs" in second[3]["content"]
    assert third[:4] == second
    assert "expected at least one walker for crosswalk, found none" in third[5]["content"]
    kept = entries(tmp_path)
    assert [entry["answer"] for entry in kept] == list(answers)
    assert "surprise" in kept[0]["problems"] and "walker" in kept[1]["problems"] and "problems" not in kept[2]
    assert kept[2]["request"]["messages"] == third


@pytest.mark.parametrize("attempts", [1, 3])
def test_a_model_that_never_gets_it_right_is_asked_so_often_and_rejected(attempts: int, tmp_path: Path) -> None:
    with served(saying(broken(needs_merge=True))) as service, pytest.raises(ProposalRejected) as caught:
        propose(CROSSWALK, "7", settings_for(service.url, attempts=attempts, transcripts=tmp_path))
    assert caught.value.stage is PipelineStage.RULES
    assert "never proposed a valid crosswalk" in caught.value.reason
    assert "needs_merge: expected false for crosswalk, found true" in caught.value.reason
    assert len(service.requests) == attempts == len(entries(tmp_path))


def test_the_last_word_of_a_model_that_fails_is_short() -> None:
    text = broken(actors=[{"actor_id": "x" * 30 + str(n), "kind": "ufo"} for n in range(50)])
    with served(saying(text)) as service, pytest.raises(ProposalRejected) as caught:
        propose(CROSSWALK, "7", settings_for(service.url))
    assert "\n" not in caught.value.reason and len(caught.value.reason) < 400
    told = service.requests[1]["messages"][3]["content"]
    assert "and 88 more" in told and len(told) < 2500


def hanging(request: dict[str, Any]) -> tuple[int, bytes]:
    time.sleep(60.0)
    return 200, completion(good().model_dump_json())


@pytest.mark.parametrize(
    ("answering", "reason", "asked"),
    [
        (hanging, "no answer within 1 s", 1),
        (lambda _: (500, b"oops"), "HTTP status 500", 3),
        (lambda _: (200, b"<html>"), "the body is no JSON", 3),
        (lambda _: (200, b'{"choices": []}'), "no choices", 3),
        (lambda _: (200, completion("x" * 40_000)), "at most 32000 are allowed", 3),
    ],
)
def test_no_answer_at_all_ends_with_one_sentence(answering: Answering, reason: str, asked: int, tmp_path: Path) -> None:
    limit_s = 1.0 if "within" in reason else 30.0
    with served(answering) as service, pytest.raises(InputError) as caught:
        propose(CROSSWALK, "7", settings_for(service.url, timeout_s=limit_s, transcripts=tmp_path))
    assert str(caught.value).startswith("language model: expected a proposal for crosswalk, found no answer: ")
    assert reason in str(caught.value) and "\n" not in str(caught.value)
    assert len(service.requests) == asked == len(entries(tmp_path))
    assert all("error" in entry for entry in entries(tmp_path))


def test_a_refused_connection_ends_with_one_sentence() -> None:
    with socket.socket() as taken:  # bound, but not listening
        taken.bind(("127.0.0.1", 0))
        with pytest.raises(InputError, match="no answer: connection: ConnectError"):
            propose(CROSSWALK, "7", settings_for(f"http://127.0.0.1:{taken.getsockname()[1]}"))


def test_an_error_of_the_service_costs_an_attempt_and_no_more() -> None:
    answers = [(503, b"busy"), (200, completion(good().model_dump_json()))]
    with served(lambda _: answers.pop(0)) as service:
        assert propose(CROSSWALK, "7", settings_for(service.url, attempts=2)) == good()


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("", "one JSON object"),
        ("}{", "one JSON object"),
        ("{category: 1}", "Invalid JSON"),
        ('{"category": "crosswalk"}', "ego_vehicles: Field required"),
        ('{"a": ' + "[" * 30000 + "}", "Invalid JSON"),
        ('{"description": "\ud800"}', "unable to parse raw data as a unicode string"),
        (good(DEADLOCK).model_dump_json(), "category: expected crosswalk, found deadlock"),
        (broken(actors=[{"actor_id": "p", "kind": "walker", "affects_vehicle": "Vehicle 9"}]), "found Vehicle 9"),
        (broken(pre_crash=3), "pre_crash: expected none for crosswalk, found 3"),
    ],
)
def test_unusable_answers_say_what_is_wrong(text: str, wrong: str) -> None:
    with pytest.raises(ValueError, match=wrong):
        parse_proposal(text, CROSSWALK)


@pytest.mark.parametrize(
    "answers",
    [
        (good().model_dump_json(),),
        ("I cannot do that.", broken(actors=[]), f"```{good().model_dump_json()}```"),
    ],
)
def test_a_replay_gives_the_same_recipe_without_a_service(answers: Sequence[str], tmp_path: Path) -> None:
    with served(saying(*answers)) as service:
        live = propose(CROSSWALK, "crosswalk/7", settings_for(service.url, transcripts=tmp_path))
    asked = len(service.requests)
    again = propose(CROSSWALK, "crosswalk/7", LlmSettings(replay=tmp_path))
    assert again == live and len(service.requests) == asked
    recipes = [Recipe(id="crosswalk_7", seed="crosswalk/7", proposal=proposal) for proposal in (live, again)]
    assert recipes[0] == recipes[1] and live.model_dump_json() == again.model_dump_json()


def failure(action: Callable[[], object]) -> tuple[type, str]:
    with pytest.raises((InputError, ProposalRejected)) as caught:
        action()
    return caught.type, str(caught.value)


@pytest.mark.parametrize("answering", [saying("no", "{}", broken(actors=[])), lambda _: (500, b"")])
def test_a_replay_fails_as_the_model_failed(answering: Answering, tmp_path: Path) -> None:
    with served(answering) as service:
        settings = settings_for(service.url, transcripts=tmp_path)
        live = failure(lambda: propose(CROSSWALK, "7", settings))
    assert failure(lambda: propose(CROSSWALK, "7", LlmSettings(replay=tmp_path))) == live


def test_a_replay_of_what_was_never_recorded_says_so(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"crosswalk_7\.jsonl: expected a text file, found none"):
        propose(CROSSWALK, "7", LlmSettings(replay=tmp_path))
    with served(saying(good().model_dump_json())) as service:
        propose(CROSSWALK, "7", settings_for(service.url, transcripts=tmp_path))
    transcript_path(tmp_path, CROSSWALK, "7").rename(transcript_path(tmp_path, CROSSWALK, "8"))
    with pytest.raises(InputError, match="no exchange for this category and seed"):
        propose(CROSSWALK, "8", LlmSettings(replay=tmp_path))
    transcript_path(tmp_path, CROSSWALK, "8").write_text("nonsense\n")
    with pytest.raises(InputError, match="line 1: expected an exchange"):
        propose(CROSSWALK, "8", LlmSettings(replay=tmp_path))


def test_the_key_comes_from_the_environment_and_is_kept_nowhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SOME_KEY", "very-secret")
    with served(saying(good().model_dump_json())) as service:
        propose(CROSSWALK, "7", settings_for(service.url, api_key_env="SOME_KEY", transcripts=tmp_path))
        assert service.headers["Authorization"] == "Bearer very-secret"
        assert "very-secret" not in json.dumps(service.requests)
        assert "very-secret" not in transcript_path(tmp_path, CROSSWALK, "7").read_text()
        monkeypatch.delenv("SOME_KEY")
        with pytest.raises(InputError, match="api_key_env: expected the name of a set environment variable"):
            propose(CROSSWALK, "7", settings_for(service.url, api_key_env="SOME_KEY"))


@pytest.mark.parametrize(
    ("more", "wrong"),
    [
        ({"endpoint": ""}, "option endpoint: expected the URL"),
        ({"attempts": 0}, "attempts: expected 1 to 10, found 0"),
        ({"timeout_s": 0.0}, "timeout_s: expected more than 0"),
        ({"timeout_s": float("nan")}, "timeout_s: expected more than 0"),
        ({"temperature": -1.0}, "temperature: expected 0 to 2"),
        ({"examples": Path("/nowhere")}, "examples /nowhere: expected a folder"),
    ],
)
def test_settings_that_make_no_sense_are_refused(more: dict[str, Any], wrong: str) -> None:
    with pytest.raises(InputError, match=wrong):
        propose(CROSSWALK, "7", settings_for("http://127.0.0.1:9", **more))


def test_transcripts_that_cannot_be_written_end_with_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with served(saying(good().model_dump_json())) as service, pytest.raises(InputError, match="cannot be written"):
        propose(CROSSWALK, "7", settings_for(service.url, transcripts=tmp_path / "file"))


def test_every_rule_and_relation_is_told_in_words() -> None:
    assert set(RULES_IN_WORDS) == {rule.__name__ for rule in RULES}
    assert set(TERMS) == set(get_args(ConstraintType))
    assert list(CATEGORIES) == CATEGORY_LIST


@pytest.mark.parametrize("category", CATEGORY_LIST)
def test_the_prompt_has_schema_rules_and_the_facts_of_the_category(category: Category) -> None:
    system, user = (message["content"] for message in build_prompt(category, 7))
    assert json.loads(system.splitlines()[-1]) == Proposal.model_json_schema()
    assert all(words in system for words in (*RULES_IN_WORDS.values(), *TERMS))
    facts = CATEGORIES[category]
    assert f"{facts.cav_range[0]} to {facts.cav_range[1]}" in user and " or ".join(facts.road.topologies) in user
    assert facts.title in user and LEVELS[category] in user and facts.description in user


def test_examples_in_the_prompt_are_valid_answers() -> None:
    user = build_prompt(DEADLOCK, 7)[1]["content"]
    shown = [line for line in user.splitlines() if line.startswith("{")]
    assert len({parse_proposal(line, DEADLOCK).model_dump_json() for line in shown}) == 2


def test_seeds_ask_differently_and_the_same_seed_asks_the_same() -> None:
    with served(saying(good().model_dump_json())) as service:
        for seed in ("1", "2", "1"):
            propose(CROSSWALK, seed, settings_for(service.url, temperature=0.3, model="m"))
    one, two, again = service.requests
    assert one == again and one["seed"] != two["seed"]
    assert one["messages"][0] == two["messages"][0] and one["messages"][1] != two["messages"][1]
    assert (one["temperature"], one["model"], one["max_tokens"]) == (0.3, "m", 4096)


def test_wished_numbers_have_the_means_of_the_papers_table() -> None:
    wishes = [build_prompt(CROSSWALK, n)[1]["content"].split("This one is to have ")[1] for n in range(100)]
    cavs = sum(int(wish.split()[0]) for wish in wishes) / 100
    actors = sum(int(wish.split(" and ")[1].split()[0]) for wish in wishes) / 100
    assert cavs == pytest.approx(3.8, rel=0.05) and actors == pytest.approx(2.7, rel=0.05)


def test_demonstrations_come_before_templates(tmp_path: Path) -> None:
    for n, category in enumerate((CROSSWALK, DEADLOCK)):
        expert = good(category).model_copy(update={"description": f"An expert's {category}."})
        (tmp_path / f"{n}.json").write_text(expert.model_dump_json())
    with served(saying(good().model_dump_json())) as service:
        propose(CROSSWALK, "7", settings_for(service.url, examples=tmp_path))
    user = service.requests[0]["messages"][1]["content"]
    assert "An expert's crosswalk." in user and "An expert's deadlock." not in user
    assert len([line for line in user.splitlines() if line.startswith("{")]) == 2


@pytest.mark.parametrize(
    ("text", "wrong"),
    [("{", "Invalid JSON"), (broken(topology="highway"), "expected intersection"), ("{}", "category: Field required")],
)
def test_a_demonstration_that_is_none_is_named(text: str, wrong: str, tmp_path: Path) -> None:
    (tmp_path / "bad.json").write_text(text)
    with pytest.raises(InputError, match=rf"bad\.json: .*{wrong}"):
        load_demonstrations(tmp_path, CROSSWALK)
