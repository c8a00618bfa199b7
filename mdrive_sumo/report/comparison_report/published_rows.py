"""Published rows beside those of a report: whether they belong there, and the order of the paper's buckets."""

from collections.abc import Iterable, Sequence

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.report.comparison_report.compared_agent import ComparedAgent
from mdrive_sumo.report.published_results import BUCKET_SIZES, BUCKETS, SUITES


def order_buckets(names: Iterable[str]) -> tuple[str, ...]:
    """Return buckets in the order of the paper's main table, others after them by name."""
    known = {name: i for i, name in enumerate(BUCKETS)}
    return tuple(sorted(names, key=lambda name: (known.get(name, len(known)), name)))


def check_published_rows(agents: Sequence[ComparedAgent]) -> None:
    """Raise InputError unless the agents drove whole buckets of the paper in a suite of this package."""
    results = agents[0].results
    if results.run.suite not in SUITES:
        raise InputError(
            f"--with-published: expected a suite of the paper's buckets ({', '.join(SUITES)}), found"
            f" {results.run.suite}"
        )
    for name, bucket in results.buckets.items():
        if bucket.scenarios != BUCKET_SIZES.get(name):
            raise InputError(
                f"--with-published: expected all {BUCKET_SIZES.get(name, 0)} scenarios of {name}, which the published"
                f" rows are means over, found {bucket.scenarios}"
            )
