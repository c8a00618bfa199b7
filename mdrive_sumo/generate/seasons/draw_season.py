"""Draw a season: search, select, and write the suites OUT/{interdrive,interaction,v2xpnp,mdrive}."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from mdrive_sumo.core.atomic_folder import atomic_folder, check_new_folder
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import make_folder
from mdrive_sumo.generate.generated_suite import write_generated_suite
from mdrive_sumo.generate.generation_search import WEATHER
from mdrive_sumo.generate.recipe import Recipe, load_recipe
from mdrive_sumo.generate.seasons.season_bucket import BucketRequest, find_bucket_drawer
from mdrive_sumo.generate.seasons.season_candidate import RECIPES_FOLDER, SCENARIOS_FOLDER
from mdrive_sumo.generate.seasons.season_plan import list_selections
from mdrive_sumo.generate.seasons.season_search import SeasonProgress, SeasonSearch, select_season
from mdrive_sumo.generate.seasons.season_seed import SeasonSeed
from mdrive_sumo.roads.netconvert import find_netconvert
from mdrive_sumo.runs.journal import JOURNAL_FILE, open_journal, read_fingerprint
from mdrive_sumo.scenario.scenario import Scenario, load_scenario
from mdrive_sumo.scenario.statistics import PAPER
from mdrive_sumo.scenario.suite import NETWORKS_FOLDER, SUITE_FILE, Suite, SuiteFile, load_suite, save_suite

BUCKETS: Final = ("interdrive", "interaction", "v2xpnp")
WHOLE: Final = "mdrive"
TITLES: Final[Mapping[str, str]] = {
    "interdrive": "InterDrive: conflicts of CAVs without other traffic",
    "interaction": "Interaction: the paper's eleven categories",
    "v2xpnp": "V2XPnP: synthetic recordings of dense traffic",
    WHOLE: "MDrive: InterDrive, Interaction and V2XPnP",
}


@dataclass(frozen=True, slots=True)
class SeasonRequest:
    """A season to draw."""

    seed: SeasonSeed
    out: Path
    buckets: Sequence[str] = BUCKETS
    workers: int = 1
    per_group: int | None = None
    """At most so many scenarios per category, for a small season; None: the composition of the paper."""

    @property
    def work(self) -> Path:
        """Return the folder of what an interrupted search continues with."""
        return self.out.with_name(f"{self.out.name}.work")

    def describe(self, bucket: str) -> dict[str, str | int]:
        """Return what makes two searches of a bucket the same, see `runs.journal`."""
        return self.seed.describe() | {"bucket": bucket, "per_group": self.per_group or 0}


def draw_season(request: SeasonRequest, progress: SeasonProgress) -> list[Suite]:
    """Draw buckets of a season and, once all are there, the suite of them all. Raises InputError.

    Each suite's folder appears when it is complete. An interrupted search continues in the work folder.
    """
    missing = [bucket for bucket in request.buckets if not _is_done(request, bucket)]
    for bucket in missing:
        check_new_folder(request.out / bucket)
    find_netconvert()
    make_folder(request.work, may_be_link=True)
    suites = [
        _draw_bucket(request, bucket, progress) if bucket in missing else load_suite(str(request.out / bucket))
        for bucket in request.buckets
    ]
    if all((request.out / bucket / SUITE_FILE).is_file() for bucket in BUCKETS):
        suites.append(_write_whole(request))
    return suites


def _is_done(request: SeasonRequest, bucket: str) -> bool:
    """Return whether an earlier try of the same season wrote a bucket."""
    if not all(path.is_file() for path in (request.out / bucket / SUITE_FILE, request.work / bucket / JOURNAL_FILE)):
        return False
    return read_fingerprint(request.work / bucket) == request.describe(bucket)


def _draw_bucket(request: SeasonRequest, bucket: str, progress: SeasonProgress) -> Suite:
    folder, about = request.out / bucket, _describe_suite(request, bucket)
    work = request.work / bucket
    if bucket == "v2xpnp":
        count = min(PAPER[bucket].scenarios, request.per_group or PAPER[bucket].scenarios)
        with atomic_folder(folder) as draft:
            find_bucket_drawer(bucket)(
                BucketRequest(
                    request.seed, request.describe(bucket), about, draft, work, count, request.workers, progress.note
                )
            )
        return load_suite(str(folder))
    with open_journal(work, request.describe(bucket), fresh=False) as journal:
        search = SeasonSearch(request.seed, work, journal, progress)
        selections = list_selections(bucket, request.per_group)
        search.run([group for selection in selections for group in selection.groups], request.workers)
        made = [
            pair
            for selection in selections
            for pair in _read_chosen([item.id for item in select_season(search, selection, request.seed)], work, bucket)
        ]
    networks = {scenario.network: work / NETWORKS_FOLDER / scenario.network for _, scenario in made}
    return write_generated_suite(about, made, folder, networks=networks)


def _read_chosen(ids: Sequence[str], work: Path, bucket: str) -> list[tuple[Recipe, Scenario]]:
    """Return recipes and scenarios of the work folder, those of Interaction with the weather of their number."""
    found: list[tuple[Recipe, Scenario]] = []
    for number, name in enumerate(ids):
        weather = {"weather": WEATHER[number % len(WEATHER)]} if bucket == "interaction" else {}
        recipe = load_recipe(work / RECIPES_FOLDER / f"{name}.json")
        scenario = load_scenario(work / SCENARIOS_FOLDER / f"{name}.json")
        found.append((recipe.model_copy(update=weather), scenario.model_copy(update=weather)))
    return found


def _describe_suite(request: SeasonRequest, name: str) -> SuiteFile:
    season = request.seed.season
    return SuiteFile(
        name=name,
        title=f"{TITLES[name]}, season {season}",
        description=f"Season {season}, drawn by `mdrive-sumo generate --season`"
        + (" with a secret." if request.seed.secret else "."),
        season=season,
        parts=BUCKETS if name == WHOLE else (),
    )


def _write_whole(request: SeasonRequest) -> Suite:
    seasons = {load_suite(str(request.out / bucket)).about.season for bucket in BUCKETS}
    if seasons != {request.seed.season}:
        other = next(season for season in seasons if season != request.seed.season)
        raise InputError(f"{request.out}: expected three buckets of season {request.seed.season}, found one of {other}")
    if not (request.out / WHOLE / SUITE_FILE).is_file():
        with atomic_folder(request.out / WHOLE) as draft:
            save_suite(Suite(_describe_suite(request, WHOLE), draft, ()))
    return load_suite(str(request.out / WHOLE))
