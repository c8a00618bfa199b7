"""Prompt for a language model: the schema, the rules in words, the category's requirements, and examples."""

import json
import random
from collections.abc import Mapping, Sequence

from mdrive_sumo.generate.category_requirements import CATEGORIES, Category, CategoryRequirements, RoadRequirements
from mdrive_sumo.generate.proposal import Proposal
from mdrive_sumo.generate.template_proposer import TEMPLATES
from mdrive_sumo.generate.template_proposer import propose as from_template
from mdrive_sumo.scenario.categories import LEVELS

RULES_IN_WORDS: Mapping[str, str] = {
    "_check_topology": "topology is one of those that the category allows.",
    "_check_needs": "The four needs_* are exactly as the category has them.",
    "_check_ego_count": "ego_vehicles: as many as the category allows.",
    "_check_ego_ids": 'ego_vehicles have the ids "Vehicle 1", "Vehicle 2" and so on, in this order, without gaps.',
    "_check_actor_count": "actors: at most 8 together, quantities counted.",
    "_check_actor_ids": "Every actor_id occurs once.",
    "_check_known_ids": "a and b of every constraint, and affects_vehicle of every actor, are ids of ego_vehicles.",
    "_check_no_self_relation": "No constraint relates a vehicle to itself.",
    "_check_contradictions": "Constraints do not contradict one another: one vehicle comes from the approach of the"
    " other, or"
    " from the opposite one, or from its right, or from its left; and it is in the other's lane, or left of it, or"
    ' right of it. Mirrored ones count: "a left_lane_of b" is "b right_lane_of a"; so with perpendicular_right_of and'
    " perpendicular_left_of.",
    "_check_crossing_actors": "Only a walker or cyclist has the motion cross_perpendicular.",
    "_check_static_actors": "A static_prop or parked_vehicle has the motion static.",
    "_check_conflict_relation": "With more than one vehicle at least one constraint is opposite_approach_of,"
    " perpendicular_right_of,"
    " perpendicular_left_of, left_lane_of, right_lane_of, merges_into_lane_of or same_lane_as.",
    "_check_oncoming_relation": "needs_oncoming asks for an opposite_approach_of.",
    "_check_lane_relation": "needs_multi_lane asks for a left_lane_of, right_lane_of, same_lane_as or"
    " merges_into_lane_of.",
    "_check_merge_relation": "needs_merge and needs_on_ramp ask for a merges_into_lane_of.",
    "_check_ramp_roads": "needs_on_ramp asks for a vehicle with entry_road main and one with entry_road side.",
    "_check_unprotected_left": "unprotected-left: a vehicle that turns left is opposite_approach_of one that goes"
    " straight.",
    "_check_walkers": "crosswalk: at least one actor is a walker.",
    "_check_no_lane_change": "blocked-lane: no vehicle has the maneuver lane_change.",
    "_check_overtaking": "overtaking: an actor with motion static affects Vehicle 1, and Vehicle 2 is"
    " opposite_approach_of"
    " Vehicle 1.",
    "_check_typology": "pre_crash is the number of the NHTSA typology for the category pre-crash, and null for all"
    " others.",
}
"""The text of every rule of rules.py, by its name."""
ROLE = (
    "You design traffic scenarios that test how connected automated vehicles (CAVs) cooperate. A scenario is good if"
    " its CAVs and actors get in each other's way at about the same time, so that driving on blindly is dangerous while"
    " careful drivers who cooperate all get through. You say who does what and how they stand to each other; places,"
    " speeds and times are worked out from that on a map. Traffic keeps right."
)
TERMS: Mapping[str, str] = {
    "same_approach_as": "a enters by the road by which b enters",
    "same_road_as": "as same_approach_as",
    "opposite_approach_of": "a and b come towards each other",
    "perpendicular_right_of": "a comes from b's right",
    "perpendicular_left_of": "a comes from b's left",
    "same_exit_as": "a and b leave by the same road",
    "follow_route_of": "a takes the way of b, before or behind it",
    "left_lane_of": "a enters in the next lane to the left of b's",
    "right_lane_of": "a enters in the next lane to the right of b's",
    "merges_into_lane_of": "a enters in another lane than b and ends up in b's",
    "same_lane_as": "a and b enter in the same lane",
}
"""Meaning of the constraints, as route_assignment.py applies them."""


EXAMPLE_COUNT = 2
"""Number of examples in context; with more a model repeats them."""
_FORM = (
    "Answer with nothing but one JSON object that is valid by this JSON Schema. Leave out fields with default values."
)


def build_prompt(category: Category, number: int, shown: Sequence[Proposal] = ()) -> list[dict[str, str]]:
    """Return the messages that request a proposal; `number` seeds the requested size and the template examples that
    `shown` lacks."""
    rng = random.Random(f"{category}/{number}")
    lines = [
        *_describe_category(category),
        f"This one is to have {_choose_size(category, rng)}.",
        *_format_examples(_choose_examples(category, shown, rng)),
        f"Propose a scenario of the category {category} unlike the examples (variation {number}).",
    ]
    return [{"role": "system", "content": _build_system_prompt()}, {"role": "user", "content": "\n".join(lines)}]


def _build_system_prompt() -> str:
    terms = "\n".join(f"- {name}: {meaning}" for name, meaning in TERMS.items())
    rules = "\n".join(f"- {words}" for words in RULES_IN_WORDS.values())
    schema = json.dumps(Proposal.model_json_schema(), separators=(",", ":"))
    return f"{ROLE}\n\nConstraints:\n{terms}\n\nRules:\n{rules}\n\n{_FORM}\n{schema}"


def _describe_category(category: Category) -> list[str]:
    facts = CATEGORIES[category]
    least, most = facts.cav_range
    return [
        f"Category: {category} ({facts.title}), interactivity level {LEVELS[category]}.",
        facts.description,
        f"topology: {' or '.join(facts.road.topologies)}. {_describe_needs(category, facts.road)}",
        f"ego_vehicles: {least} to {most}.",
    ]


def _describe_needs(category: Category, needs: RoadRequirements) -> str:
    if category is Category.PRE_CRASH:
        return "needs_*: as the typology asks."
    flags = {name: getattr(needs, name) for name in ("oncoming", "multi_lane", "on_ramp", "merge")}
    return ", ".join(f"needs_{name}: {str(flag).lower()}" for name, flag in flags.items()) + "."


def _choose_size(category: Category, rng: random.Random) -> str:
    """Return numbers of CAVs and actors around the means of the paper's table, so that a set of proposals matches
    them."""
    facts = CATEGORIES[category]
    egos = min(max(_round_randomly(_mean_cavs(facts), rng), facts.cav_range[0]), facts.cav_range[1])
    wish = f"{egos} ego_vehicles"
    return (
        wish
        if facts.paper is None
        else f"{wish} and {_round_randomly(facts.paper.actors, rng)} actors, quantities counted"
    )


def _mean_cavs(facts: CategoryRequirements) -> float:
    return facts.paper.cavs if facts.paper else sum(facts.cav_range) / 2


def _round_randomly(mean: float, rng: random.Random) -> int:
    """Return an integer next to the mean, randomly rounded such that its expectation is the mean."""
    return int(mean) + (rng.random() < mean % 1)


def _choose_examples(category: Category, shown: Sequence[Proposal], rng: random.Random) -> list[Proposal]:
    """Return demonstrations, a sample if there are many, filled up with templates if there are few."""
    chosen = rng.sample(list(shown), min(EXAMPLE_COUNT, len(shown)))
    missing = EXAMPLE_COUNT - len(chosen) if category in TEMPLATES else 0
    return chosen + [from_template(category, rng) for _ in range(missing)]


def _format_examples(chosen: Sequence[Proposal]) -> list[str]:
    return ["Examples:", *(proposal.model_dump_json(exclude_defaults=True) for proposal in chosen)] if chosen else []
