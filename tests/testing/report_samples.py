"""Runs made by hand for reports: valid results files, without simulation. No tests in here."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from mdrive_sumo.core.state import End
from mdrive_sumo.scoring import EgoResult, Infraction, Results, RunInfo, ScenarioResult, save_results, summarize_run
from mdrive_sumo.scoring.score_mode import SUCCESS_DS
from mdrive_sumo.v2x.comm_settings import PRESETS, describe_comm

PLACES = {
    "i01": ("InterDrive", "ins_ss"),
    "i02": ("InterDrive", "ins_c"),
    "cone": ("Interaction", "construction"),
    "walker": ("Interaction", "crosswalk"),
    "left": ("Interaction", "unprotected-left"),
    "log": ("V2XPnP", "synthetic"),
}
"""Scenarios by id, with bucket and category: all three buckets and interactivity levels."""
CRASH = 60.0
"""The driving score of a CAV that collides once with a vehicle and arrives."""
Scores = Mapping[str, Sequence[float]]


def make_drive(name: str, scores: Sequence[float], seed: int = 0, exchanged: Iterable[str] = ()) -> ScenarioResult:
    """Return the result of a scenario of `PLACES` by the driving scores of its CAVs; no scores: it is void.

    100 arrives in 1.5 times the reference, `CRASH` does so with a collision, anything else is blocked on its way.
    """
    bucket, category = PLACES[name]
    egos = tuple(_make_ego(str(i), score) for i, score in enumerate(scores))
    count = max(1, len(egos))
    ratios = [ego.time_ratio for ego in egos if ego.time_ratio is not None]
    succeed = 100.0 * sum(score > SUCCESS_DS for score in scores) / count
    return ScenarioResult(
        id=name,
        bucket=bucket,
        category=category,
        seed=seed,
        status="ok" if scores else "void",
        reason="" if scores else "SUMO stopped",
        ds=sum(scores) / count,
        sr=succeed,
        rc=sum(ego.rc for ego in egos) / count,
        ip=sum(ego.ip for ego in egos) / count,
        efficient_sr=succeed if scores else None,
        time_ratio=1.5 if ratios and len(ratios) == len(egos) else None,
        min_ttc=0.5 if CRASH in scores else None,
        scalars={"mean_speed": 5.0, "comfort": 90.0, "min_pet": None, "message_rate": 100.0} if scores else {},
        digest="",
        ticks=300 if scores else 0,
        egos=egos,
        exchanged=dict.fromkeys(exchanged, 1) if scores else {},
    )


def _make_ego(name: str, score: float) -> EgoResult:
    has_arrived = score in (100.0, CRASH)
    crash = Infraction(kind="collision-vehicle", tick=9, x=0, y=0, factor=0.6, other="1", impact_speed=3.0)
    return EgoResult(
        id=name,
        outcome=End.ARRIVED if has_arrived else End.BLOCKED,
        reason="",
        ds=score,
        rc=100.0 if has_arrived else score,
        ip=0.6 if score == CRASH else 1.0,
        ticks=300,
        time_ratio=1.5 if has_arrived else None,
        infractions=(crash,) if score == CRASH else (),
    )


def make_agent_run(
    agent: str,
    scores: Scores,
    seeds: Sequence[int] = (0,),
    exchanged: Iterable[str] = (),
    channel: str = "ideal",
    track: str = "",
    **facts: object,
) -> Results:
    """Return a run with the same scores for each seed. track: its sensing track; "": as of results without one."""
    about = {
        "agent": agent,
        "suite": "made-up",
        "suite_checksum": "sha256:" + "1" * 64,
        "seed": seeds[0],
        "seeds": seeds if len(seeds) > 1 else (),
        "score_mode": "mdrive",
        "versions": {"mdrive-sumo": "0.1.0", "libsumo": "1.28.0", "python": "3.11.7"},
        "comm": describe_comm(PRESETS[channel]),
        "ids": "random",
        "sensing": "realistic",
    }
    kinds = tuple(exchanged)
    drives = [make_drive(name, found, seed, kinds) for seed in seeds for name, found in scores.items()]
    drives = [drive.model_copy(update={"sensing_track": track}) for drive in drives]
    return summarize_run(RunInfo.model_validate(about | facts), drives)


SINGLE: Scores = {
    **{"i01": (100.0, 20.0), "i02": (CRASH, CRASH), "cone": (100.0, 100.0)},
    **{"walker": (0.0, 40.0), "left": (100.0, CRASH), "log": (100.0,)},
}
SHARING: Scores = {**SINGLE, "i01": (100.0, 100.0), "walker": (100.0, CRASH)}
BEST: Scores = dict.fromkeys(SINGLE, (100.0, 100.0))


def make_sample_runs() -> dict[str, Results]:
    """Return runs by the name of their folder: single, sharing with and without its channel, and omniscient.

    All with two seeds.
    """
    seeds = (0, 1)
    return {
        "single": make_agent_run("single", SINGLE, seeds),
        "sharing": make_agent_run("sharing", SHARING, seeds, exchanged=("cam", "cpm")),
        "off": make_agent_run("sharing", SINGLE, seeds, channel="off"),
        "omniscient": make_agent_run("omniscient", BEST, seeds, labels=("privileged",)),
    }


def save_run(folder: Path, results: Results) -> Path:
    """Write a run's folder with its results and no journal, and return it."""
    folder.mkdir(parents=True)
    save_results(results, folder / "results.json")
    return folder


def save_sample_runs(folder: Path) -> list[Path]:
    """Write the runs of `make_sample_runs` and return their folders."""
    return [save_run(folder / name, results) for name, results in make_sample_runs().items()]
