"""What a language model is asked: the schema, the rules in words, the category's facts, and examples."""

import json
import random
from collections.abc import Sequence

from mdrive_sumo.generate.category_requirements import CATEGORIES, Category, CategoryRequirements, RoadRequirements
from mdrive_sumo.generate.llm_prompt_texts import ABOUT, ROLE, RULES_IN_WORDS, TERMS
from mdrive_sumo.generate.proposal import Proposal
from mdrive_sumo.generate.template_proposer import TEMPLATES
from mdrive_sumo.generate.template_proposer import propose as from_template
from mdrive_sumo.scenario.categories import LEVELS

EXAMPLES = 2
"""In context; more make a model repeat them."""
_FORM = (
    "Answer with nothing but one JSON object that is valid by this JSON Schema. Leave out fields with default values."
)


def build_prompt(category: Category, number: int, shown: Sequence[Proposal] = ()) -> list[dict[str, str]]:
    """Asks for a proposal; `number` draws what is wished for, and templates for the examples that `shown` lacks."""
    rng = random.Random(f"{category}/{number}")
    lines = [
        *_facts(category),
        f"This one is to have {_wish(category, rng)}.",
        *_examples(_chosen(category, shown, rng)),
        f"Propose a scenario of the category {category} unlike the examples (variation {number}).",
    ]
    return [{"role": "system", "content": _system()}, {"role": "user", "content": "\n".join(lines)}]


def _system() -> str:
    terms = "\n".join(f"- {name}: {meaning}" for name, meaning in TERMS.items())
    rules = "\n".join(f"- {words}" for words in RULES_IN_WORDS.values())
    schema = json.dumps(Proposal.model_json_schema(), separators=(",", ":"))
    return f"{ROLE}\n\nConstraints:\n{terms}\n\nRules:\n{rules}\n\n{_FORM}\n{schema}"


def _facts(category: Category) -> list[str]:
    facts = CATEGORIES[category]
    least, most = facts.cav_range
    return [
        f"Category: {category} ({facts.title}), interactivity level {LEVELS[category]}.",
        ABOUT[category],
        f"topology: {' or '.join(facts.road.topologies)}. {_needed(category, facts.road)}",
        f"ego_vehicles: {least} to {most}.",
    ]


def _needed(category: Category, needs: RoadRequirements) -> str:
    if category is Category.PRE_CRASH:
        return "needs_*: as the typology asks."
    flags = {name: getattr(needs, name) for name in ("oncoming", "multi_lane", "on_ramp", "merge")}
    return ", ".join(f"needs_{name}: {str(flag).lower()}" for name, flag in flags.items()) + "."


def _wish(category: Category, rng: random.Random) -> str:
    """Numbers of CAVs and actors around the means of the paper's table, so that a set comes out like it."""
    facts = CATEGORIES[category]
    egos = min(max(_drawn(_mean_cavs(facts), rng), facts.cav_range[0]), facts.cav_range[1])
    wish = f"{egos} ego_vehicles"
    return wish if facts.paper is None else f"{wish} and {_drawn(facts.paper.actors, rng)} actors, quantities counted"


def _mean_cavs(facts: CategoryRequirements) -> float:
    return facts.paper.cavs if facts.paper else sum(facts.cav_range) / 2


def _drawn(mean: float, rng: random.Random) -> int:
    """An integer next to the mean, so often that the mean comes out."""
    return int(mean) + (rng.random() < mean % 1)


def _chosen(category: Category, shown: Sequence[Proposal], rng: random.Random) -> list[Proposal]:
    """Demonstrations, drawn if there are many; templates if there are few."""
    chosen = rng.sample(list(shown), min(EXAMPLES, len(shown)))
    missing = EXAMPLES - len(chosen) if category in TEMPLATES else 0
    return chosen + [from_template(category, rng) for _ in range(missing)]


def _examples(chosen: Sequence[Proposal]) -> list[str]:
    return ["Examples:", *(proposal.model_dump_json(exclude_defaults=True) for proposal in chosen)] if chosen else []
