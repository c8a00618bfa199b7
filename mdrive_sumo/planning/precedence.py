"""Orders that respect precedence and urgency."""

from collections.abc import Collection, Mapping, Sequence


def order_by_urgency(
    group: Sequence[str],
    urgency: Mapping[str, float],
    before: Collection[tuple[str, str]],
    own_urgency_breaks_ties: bool = True,
) -> tuple[str, ...]:
    """Return the group sorted by urgency (smallest value first) such that every pair (first, second) is respected.

    A member that must precede an urgent one inherits its urgency. A cycle is cut at its most urgent member. Ties go to
    the smaller own urgency (unless `own_urgency_breaks_ties` is False), then to the smaller id.
    """
    inherited = {name: urgency[name] for name in group}
    pairs = [(first, second) for first, second in before if first in inherited and second in inherited]
    for _ in group:
        for first, second in pairs:
            inherited[first] = min(inherited[first], inherited[second])
    own = urgency if own_urgency_breaks_ties else dict.fromkeys(group, 0.0)
    left = sorted(group, key=lambda name: (inherited[name], own[name], name))
    order: list[str] = []
    while left:
        free = [name for name in left if not any(second == name and first in left for first, second in pairs)]
        order.append((free or left)[0])
        left.remove(order[-1])
    return tuple(order)
