"""`mdrive-sumo list`."""

import json
import os
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.contract.agent_options import AgentFactory
from mdrive_sumo.core.checksum import SHORT_CHECKSUM
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.plug_ins import PREFIX, PlugIn, PlugInKind, list_plug_ins
from mdrive_sumo.core.tables import format_text, make_text_table
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.generate.validation import is_hard_suite
from mdrive_sumo.open_loop import OPEN_LOOP_FILE
from mdrive_sumo.report.agent_failures import list_agent_failures
from mdrive_sumo.roads import list_packaged_networks, load_road_map
from mdrive_sumo.roads.network_file import NETWORK_FILE, read_network_file
from mdrive_sumo.runs.run_config import RUNS_FOLDER
from mdrive_sumo.runs.run_folder import ListedRun, list_runs, load_run_results
from mdrive_sumo.scenario.categories import FIGURES, Category
from mdrive_sumo.scenario.packaged_suites import list_packaged_suites, list_seasons
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.season import join_suite_name, read_stored_name
from mdrive_sumo.scenario.statistics import PAPER, SuiteStatistics, compute_suite_statistics
from mdrive_sumo.scenario.suite import Suite, load_suite
from mdrive_sumo.scoring.metrics import METRICS, InfractionMetric
from mdrive_sumo.scoring.metrics.registry import load_metric_plug_ins
from mdrive_sumo.sensing.sensor_kinds import derive_sensing_track
from mdrive_sumo.study.need_certificate import NeedCertificate, NeedCertificateFile, Proof
from mdrive_sumo.study.occlusion_certificate import CERTIFICATE_FILE, OcclusionCertificate, OcclusionCertificateFile

STATISTICS_HEADER: Sequence[str] = ("scenarios", "CAVs", "mean CAVs", "route [m]", "heading change [deg]", "background")


def _list_suites(_: str) -> str:
    return "\n\n".join(_format_suite(load_suite(name)) for name in list_packaged_suites()) or "no suites"


def _format_suite(suite: Suite) -> str:
    rows = [(suite.label, *_format_statistics(compute_suite_statistics(suite.scenarios)))]
    if suite.about.name in PAPER:
        rows.append(("in the paper", *_format_statistics(PAPER[suite.about.name])))
    tables = format_text(make_text_table(("suite", *STATISTICS_HEADER), rows))
    parts = [suite.about.title, "", tables, ""]
    if len(seasons := list_seasons(suite.about.name)) > 1:
        parts += [f"seasons: {', '.join(join_suite_name(suite.about.name, season) for season in seasons)}", ""]
    if suite.about.parts:
        return "\n".join((*parts, f"parts: {', '.join(suite.about.parts)}"))
    return "\n".join((*parts, _format_categories(suite)))


def _format_categories(suite: Suite) -> str:
    """Return the means of every category, with the paper's where it has a table of them."""
    rows: list[Sequence[str]] = []
    for name in dict.fromkeys(scenario.category for scenario in suite.scenarios):
        found = compute_suite_statistics([scenario for scenario in suite.scenarios if scenario.category == name])
        rows.append((name, *_format_statistics(found)))
        if name in set(Category) and (paper := FIGURES.get(Category(name))) is not None:
            rows.append(("  in the paper", str(paper.count), "", *(f"{mean:.2f}" for mean in paper.means)))
    return format_text(make_text_table(("category", *STATISTICS_HEADER), rows))


def _format_statistics(found: SuiteStatistics) -> Sequence[str]:
    means = (found.mean_cavs, found.mean_route_m, found.mean_heading_change_deg, found.mean_actors)
    return (str(found.scenarios), str(found.cavs), *(f"{mean:.2f}" for mean in means))


def _list_scenarios(suite: str, occluded: bool | None = None) -> str:
    loaded = load_suite(suite)
    if is_hard_suite(loaded):
        return _list_hard_scenarios(loaded, occluded)
    certificates = OcclusionCertificateFile.load(loaded)
    unknown = [part.name for part in loaded.parts or (loaded,) if part.scenarios[0].id not in certificates]
    if occluded is not None and unknown:
        raise InputError(
            f"suite {unknown[0]}: expected an up-to-date {CERTIFICATE_FILE}, found none;"
            f" `mdrive-sumo validate {suite} --write` makes it"
        )
    chosen = [
        s
        for s in loaded.scenarios
        if occluded is None or (s.id in certificates and certificates[s.id].occluded) == occluded
    ]
    header = (
        "scenario",
        "category",
        "network",
        *STATISTICS_HEADER[1:2],
        *STATISTICS_HEADER[3:],
        "hidden [s]",
        "known to",
    )
    rows = [(*_make_scenario_row(scenario), *_format_occlusion(certificates.get(scenario.id))) for scenario in chosen]
    return format_text(make_text_table(header, rows)) + f"\n\n{OCCLUSION_LEGEND if certificates else NO_CERTIFICATES}"


def _list_hard_scenarios(suite: Suite, occluded: bool | None) -> str:
    """Return the table of a suite of the hard tier, with its certificates of need."""
    if occluded is not None:
        raise InputError(
            f"suite {suite.label}: --occluded: expected a suite with {CERTIFICATE_FILE}, found the hard tier"
        )
    need = NeedCertificateFile.load(suite)
    header = ("scenario", "category", "network", *STATISTICS_HEADER[1:2], *STATISTICS_HEADER[3:], *NEED_HEADER)
    rows = [(*_make_scenario_row(scenario), *_format_need(need.get(scenario.id))) for scenario in suite.scenarios]
    counts = Counter(certificate.proves for certificate in need.values())
    counted = ", ".join(f"{proof} in {counts[proof]}" for proof in Proof)
    legend = f"{NEED_LEGEND}\n{counted} of {len(suite)} scenarios" if need else NO_CERTIFICATES
    return format_text(make_text_table(header, rows)) + f"\n\n{legend}"


def _format_need(certificate: NeedCertificate | None) -> Sequence[str]:
    if certificate is None:
        return ("?",) * len(NEED_HEADER)
    gain = f"{certificate.lead_s:.1f}" if certificate.proves else "-"
    return (certificate.proves or "-", certificate.proves_over_roofs or "-", gain)


def _make_scenario_row(scenario: Scenario) -> Sequence[str]:
    _, cavs, _, *rest = _format_statistics(compute_suite_statistics((scenario,)))
    return (scenario.id, scenario.category, scenario.network, cavs, *rest)


def _format_occlusion(certificate: OcclusionCertificate | None) -> Sequence[str]:
    if certificate is None:
        return ("?", "?")
    if not certificate.occluded:
        return ("-", "-")
    return (f"{certificate.longest_s:.1f}", "others" if certificate.by_third else "itself")


OCCLUSION_LEGEND = (
    "hidden: longest time before a conflict in which the other vehicle is hidden from a CAV but known to other CAVs\n"
    "or RSUs, or only to itself (it can send a CAM); in the constant-speed and the omniscient episode"
)
TRACK_LEGEND = (
    "track: sensor: only what a car carries (LiDAR, cameras, GNSS, IMU, map, messages) or less; object: given lists"
    " of objects"
)
NEED_HEADER = ("proves", "over roofs", "gain [s]")
NEED_LEGEND = (
    "proves: what no driver without messages can do (certificate of need, docs/hard-certificates.md):\n"
    "  all: be safe against every hidden road user and in time, at whatever speeds\n"
    "  conflict: meet one hidden conflict at the speeds that the time limit requires\n"
    "over roofs: the same with a LiDAR that looks over cars;\n"
    "gain: how much earlier than its own sensors a message tells a CAV of the road user"
)
NO_CERTIFICATES = "hidden: unknown; `mdrive-sumo validate SUITE --write` examines it"


def _list_agents(_: str) -> str:
    rows = [
        (name, _find_builtin_track(factory), (factory.__doc__ or "").strip().split("\n")[0])
        for name, factory in AGENTS.items()
    ]
    rows += [(name, "", f"of {one.package} {one.version}") for name, one in list_plug_ins(PlugInKind.AGENTS).items()]
    return format_text(make_text_table(("agent", "track", "what it does"), rows)) + f"\n\n{TRACK_LEGEND}"


def _find_builtin_track(factory: AgentFactory) -> str:
    """Return the sensing track of a built-in agent with its default options; "" if an extra is missing."""
    for config in ({}, {"transcript": os.devnull}):  # a language model without answers does to ask for the sensors
        try:
            return derive_sensing_track([factory(config).sensors()]).value
        except InputError:
            continue
    return ""


RUNS_HEADER: Sequence[str] = ("run", "suite", "agent", "seeds", "episodes", "DS", "SR", "state")


def _list_runs(folder: Path) -> str:
    rows = [_make_run_row(run) for run in list_runs(folder)]
    if not rows:
        return f"no runs below {folder}; `mdrive-sumo eval` makes one, `mdrive-sumo list runs DIR` looks elsewhere"
    return format_text(make_text_table(RUNS_HEADER, rows))


def _make_run_row(run: ListedRun) -> Sequence[str]:
    name = str(run.folder)
    if run.problem:
        return (name, *("?",) * (len(RUNS_HEADER) - 2), f"unreadable: {run.problem}")
    facts = run.fingerprint
    seeds = str(facts.get("seeds", facts.get("seed", "?")))
    known = (name, read_stored_name(Path(str(facts.get("suite", "?"))).name), _name_agent(facts), seeds)
    if run.results is None:
        state = "finished, open loop" if (run.folder / OPEN_LOOP_FILE).is_file() else _describe_state(run)
        return (*known, str(run.finished), *_list_partial_scores(run), state)
    means = run.results.overall.scenario_mean
    failed = len({(one.result.id, one.result.seed) for one in list_agent_failures(run.results)})
    states = [f"{count} {what}" for count, what in ((run.results.void, "void"), (failed, "agent failed")) if count]
    return (*known, str(run.finished), f"{means.ds:.2f}", f"{means.sr:.2f}", ", ".join(states) or "finished")


def _describe_state(run: ListedRun) -> str:
    """Return "partial: 3 of 46": a run that is going on, or was interrupted."""
    return f"partial: {run.finished} of {run.planned}" if run.planned else "interrupted"


def _list_partial_scores(run: ListedRun) -> tuple[str, str]:
    """Return DS and SR of what an unfinished run has finished."""
    try:
        means = load_run_results(run.folder).overall.scenario_mean
    except InputError:
        return ("-", "-")
    return (f"{means.ds:.2f}", f"{means.sr:.2f}")


def _name_agent(fingerprint: Mapping[str, Any]) -> str:
    """Return the agent with its options, of paths the last part."""
    name = str(fingerprint.get("agent", "?")).rpartition("/")[2]
    try:
        options = json.loads(fingerprint.get("agent_config") or "{}")
    except ValueError:
        return name
    words = [f"{key} {str(value).rpartition('/')[2]}" for key, value in sorted(options.items())]
    return f"{name} ({', '.join(words)})" if words else name


NETWORKS = "networks"


def list_networks(_: str) -> str:
    """Return the table of the packaged networks."""
    return _format_networks(list_packaged_networks())


def list_networks_of(folder: Path) -> str:
    """Return the table of the networks in a folder, or in its networks/. Raises InputError without any."""
    places = [*sorted(folder.glob("*")), *sorted((folder / NETWORKS).glob("*"))]
    folders = {place.name: place for place in places if (place / NETWORK_FILE).is_file()}
    if not folders:
        raise InputError(f"{folder}: expected networks in NAME/{NETWORK_FILE} or {NETWORKS}/NAME, found none")
    return _format_networks(folders)


def _format_networks(folders: Mapping[str, Path]) -> str:
    rows = _make_network_rows(folders)
    return format_text(make_text_table(("network", "lanes", "buildings", "stop signs", "description"), rows))


def _make_network_rows(folders: Mapping[str, Path]) -> Iterator[Sequence[str]]:
    for name, folder in folders.items():
        roads, about = load_road_map(folder), read_network_file(folder)
        signs = "unknown" if roads.stop_signs is None else str(len(roads.stop_signs))
        yield name, str(len(roads.lanes)), str(len(roads.buildings)), signs, about.description


def list_metrics(_: str) -> str:
    """Return the table of all metrics, those of other packages last. Raises InputError."""
    rows = [
        (metric.name, "changes DS" if isinstance(metric, InfractionMetric) else "informative", origin)
        for metrics, origin in ((METRICS, "built in"), (load_metric_plug_ins(), "plug-in"))
        for metric in metrics
    ]
    return format_text(make_text_table(("metric", "kind", "from"), rows))


def list_plug_in_table(_: str) -> str:
    """Return the table of the plug-ins of other packages, with what identifies them."""
    rows = [
        (
            str(kind),
            name,
            one.package,
            one.version,
            _shorten_checksum(one),
            one.locator,
        )
        for kind in PlugInKind
        for name, one in list_plug_ins(kind).items()
    ]
    if not rows:
        groups = ", ".join(f"{PREFIX}{kind}" for kind in PlugInKind)
        return f"no plug-ins are installed; their entry points are in the groups {groups}"
    return format_text(make_text_table(("kind", "name", "package", "version", "checksum", "object"), rows))


def _shorten_checksum(plug_in: PlugIn) -> str:
    return plug_in.identify().rpartition("sha256:")[2][:SHORT_CHECKSUM]


LISTS: Mapping[str, Callable[[str], str]] = {
    "suites": _list_suites,
    "scenarios": _list_scenarios,
    "agents": _list_agents,
    NETWORKS: list_networks,
    "metrics": list_metrics,
    "plug-ins": list_plug_in_table,
}


RUNS = "runs"


@click.command("list")
@click.argument("what", type=click.Choice((*LISTS, RUNS)))
@click.argument("folder", metavar="[DIR]", type=click.Path(path_type=Path), default=RUNS_FOLDER)
@click.option("--suite", default="interdrive", show_default=True, help="Suite of the scenarios: a name or a folder.")
@click.option(
    "--occluded/--not-occluded", default=None, help="Only scenarios with, or without, an occlusion certificate."
)
def command(what: str, folder: Path, suite: str, occluded: bool | None) -> None:
    """List suites (with the paper's statistics), scenarios, agents, networks, metrics, plug-ins or runs.

    Plug-ins are metrics, agents, scenario sources, readers and export formats of other packages.

    DIR is where runs are looked for, with the folders below it [default: runs], or where networks of your own are, such
    as `convert opendrive` writes [default: the packaged ones].
    """
    if what == RUNS:
        echo(_list_runs(folder))
        return
    if what == NETWORKS and folder != RUNS_FOLDER:
        echo(list_networks_of(folder))
        return
    if folder != RUNS_FOLDER:
        raise click.UsageError(
            f"DIR: expected only with `list {RUNS}` and `list {NETWORKS}`, found {str(folder)!r} with `list {what}`"
        )
    echo(_list_scenarios(suite, occluded) if what == "scenarios" else LISTS[what](suite))
