"""Prompt for a language model: the schema, the rules in words, the category's requirements, and examples."""

import json
import random
from collections.abc import Sequence

from mdrive_sumo.generate.category_requirements import CATEGORIES, Category, CategoryRequirements, RoadRequirements
from mdrive_sumo.generate.llm_prompt_texts import ROLE, RULES_IN_WORDS, TERMS
from mdrive_sumo.generate.proposal import Proposal
from mdrive_sumo.generate.template_proposer import TEMPLATES
from mdrive_sumo.generate.template_proposer import propose as from_template
from mdrive_sumo.scenario.categories import LEVELS

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
