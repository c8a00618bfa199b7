"""What the fuzz tests feed with damaged bytes: every reader of files that strangers send, with a tiny valid file."""

import gzip
import io
import json
import pickle
import sqlite3
import zipfile
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
from pyarrow import feather, parquet

from mdrive_sumo.contract import REASON, Cause, Control, Note, Reason
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import Actors, EgoState, End, Frame
from mdrive_sumo.episode import Ending, Recorder, load_episode, quantize_frame, save_episode
from mdrive_sumo.episode.camera_archive import encode_image, load_camera_tracks
from mdrive_sumo.negotiation.transcript import check_transcript
from mdrive_sumo.report.reasons import describe_reason
from mdrive_sumo.roads import find_network_folder, load_road_map
from mdrive_sumo.roads.network_file import NET_FILE, NETWORK_FILE, compute_net_checksum, read_network_file
from mdrive_sumo.runs.journal import JOURNAL_FILE, open_journal, read_run_journal
from mdrive_sumo.runs.run_config import load_agent_config
from mdrive_sumo.scenario.packaged_suites import find_suite_folder
from mdrive_sumo.scenario.scenario import load_scenario
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.scoring import ScoreMode, load_results, save_results, score_episode, summarize_run
from mdrive_sumo.study.human.plan_file import load_plan
from real2sim.carla.opendrive import read_opendrive
from real2sim.logged_drive import load_confirmed_infractions
from real2sim.pipeline.recording_transfer import TransferError, decode_value, encode_value
from real2sim.readers.argoverse2 import read_argoverse2
from real2sim.readers.carla_route import read_route_file
from real2sim.readers.commonroad import read_commonroad
from real2sim.readers.interaction import read_interaction
from real2sim.readers.lanelet2 import read_lanelet2
from real2sim.readers.levelx import read_levelx
from real2sim.readers.mdrive_manifest import BEHAVIOR, MANIFEST, read_behaviors, read_manifest
from real2sim.readers.scenarionet import read_scenarionet
from real2sim.readers.v2xpnp_frame import read_frame
from real2sim.readers.v2xpnp_map import read_vector_map
from real2sim.readers.v2xseq import read_v2xseq, read_v2xseq_map
from real2sim.recording import Recording
from real2sim.writers.v2xpnp_map import write_vector_map
from server.archive.layout import ArchiveLimits
from server.archive.manifest import check_archive
from server.settings import load_settings
from server.store.engine import check_sqlite_file
from testing import (
    archive_samples,
    argoverse2_samples,
    commonroad_samples,
    human_study,
    levelx_samples,
    opv2v_samples,
    small_log,
    v2xpnp_samples,
    v2xseq_samples,
)
from testing.interaction_samples import build_street, write_table
from testing.mdrive_directory import EGO
from testing.scenarionet_samples import description
from testing.scored_pair import PAIR, ROADS, RUN, pair_episode

OPENDRIVE = (
    '<OpenDRIVE><header date="today"/><road id="7" junction="-1" length="60"><planView>'
    '<geometry s="0" x="1" y="2" hdg="0.3" length="60"><arc curvature="0.02"/></geometry></planView><lanes>'
    '<laneSection s="0"><right><lane id="-1" type="driving"/></right></laneSection></lanes>'
    '<signals><signal id="1" s="5" t="-4" type="206"/></signals></road></OpenDRIVE>'
)


@dataclass(frozen=True)
class FuzzTarget:
    """A reader. `write` makes valid files in a folder and returns the one to damage, `read` reads that."""

    write: Callable[[Path], Path]
    read: Callable[[Path], object]
    native: bool = False
    """Whether a library in C++ parses it that may crash; `limited_reader` then keeps the damage small."""
    refusals: tuple[type[Exception], ...] = (InputError,)


def _file(name: str, content: bytes | str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return write


def _write_map(folder: Path) -> Path:
    write_vector_map(small_log.road(length=8.0), folder / "map.pkl")
    return folder / "map.pkl"


def _write_forecast(folder: Path) -> Path:
    argoverse2_samples.write_map(folder, argoverse2_samples.archive())
    path = folder / "scenario_s1.parquet"
    parquet.write_table(pa.table(argoverse2_samples.track_rows("AV", "vehicle", (0, 1, 2))), path)
    return path


def _write_map_archive(folder: Path) -> Path:
    _write_forecast(folder)
    return folder / "log_map_archive_x.json"


def _write_sweeps(folder: Path) -> Path:
    argoverse2_samples.log(folder)
    feather.write_feather(pa.table(argoverse2_samples.CAR), folder / "annotations.feather", compression="uncompressed")
    return folder / "annotations.feather"


def _write_csv(folder: Path) -> Path:
    build_street().write(folder / "map.osm")
    rows = ("1,5,500,car,1,2,10,0,0.1,4.5,1.8", "1,6,600,car,2,2,10,0,0.1,4.5,1.8")
    return write_table(folder / "vehicle_tracks_007.csv", *rows)


def _write_ground(folder: Path) -> Path:
    rows = [levelx_samples.format_ground_row(3, frame, frame * 0.4) for frame in range(5)]
    return levelx_samples.write_ground(folder, rows, {3: "car"}, frames=5)


def _write_v2xseq_map(folder: Path) -> Path:
    return v2xseq_samples.write_scene(folder, v2xseq_samples.list_rows(3))[1]


def _write_osm(folder: Path) -> Path:
    return build_street().write(folder / "map.osm")


def _write_commonroad(folder: Path) -> Path:
    text = commonroad_samples.format_scenario(commonroad_samples.LANE, commonroad_samples.CAR)
    return _file("scenario.xml", text)(folder)


def _write_recording(folder: Path) -> Path:
    recorder = Recorder("s", {}, {"0": (4.9, 2.0)})
    for tick in range(4):
        frame = Frame(tick, {"0": EgoState(tick, 0.0, 0.1, 20.0)}, Actors.empty(), {})
        recorder.add(quantize_frame(frame), {"0": Control(0.5, 0.0, 0.0)}, {}, {})
    save_episode(recorder.finish([Ending("0", 3, End.ARRIVED)]), folder / "e.npz")
    return folder / "e.npz"


def _write_member(name: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        with zipfile.ZipFile(_write_recording(folder)) as archive:
            data = archive.read(f"{name}.npy")
        header = bytes(np.load(io.BytesIO(data))) if name == "header" else data
        return _file("member", header)(folder)

    return write


def _read_member(name: str) -> Callable[[Path], object]:
    """Read a recording with a changed member: the checksum of the archive would refuse nearly all changes."""

    def read(path: Path) -> object:
        data = path.read_bytes()
        if name == "header":
            file = io.BytesIO()
            np.save(file, np.frombuffer(data, np.uint8))
            data = file.getvalue()
        with zipfile.ZipFile(path.parent / "e.npz") as archive:
            members = {one: archive.read(one) for one in archive.namelist()} | {f"{name}.npy": data}
        with zipfile.ZipFile(path.parent / "changed.npz", "w") as archive:
            for one, content in members.items():
                archive.writestr(one, content)
        return load_episode(path.parent / "changed.npz")

    return read


NETWORK = find_network_folder("crescent")


def _write_net(folder: Path) -> Path:
    return _file("plain.xml", gzip.decompress((NETWORK / NET_FILE).read_bytes()))(folder)


def _read_net(path: Path) -> object:
    xml, about = path.read_bytes(), json.loads((NETWORK / NETWORK_FILE).read_text())
    _file(NETWORK_FILE, json.dumps(about | {"checksum": compute_net_checksum(xml)}))(path.parent)
    _file(NET_FILE, gzip.compress(xml, 1))(path.parent)
    load_road_map.cache_clear()
    return load_road_map(path.parent)


def _write_suite(folder: Path) -> Path:
    source = find_suite_folder("interdrive@0")
    scenario = next(path for path in sorted(source.iterdir()) if (path / "scenario.json").is_file())
    _file(f"{scenario.name}/scenario.json", (scenario / "scenario.json").read_bytes())(folder)
    about = json.loads((source / "suite.json").read_text()) | {"checksum": ""}
    return _file("suite.json", json.dumps(about))(folder)


def _write_scenario(folder: Path) -> Path:
    _write_suite(folder)
    return next(folder.glob("*/scenario.json"))


def _write_results(folder: Path) -> Path:
    save_results(
        summarize_run(RUN, [score_episode(pair_episode(), PAIR, ROADS, ScoreMode.MDRIVE, 1)]), folder / "r.json"
    )
    return folder / "r.json"


def _write_journal(folder: Path) -> Path:
    with open_journal(folder, {"agent": "idm", "seed": 0}, fresh=False) as journal:
        journal.add_result({"id": "s", "seed": 0, "ds": 1.5}, "sha256:00")
        journal.add_failure("s", "why")
    return folder / JOURNAL_FILE


def _write_images(folder: Path) -> Path:
    with zipfile.ZipFile(folder / "images.zip", "w") as archive:
        archive.writestr("index.json", '{"cameras": [{"ego": "0", "camera": "front"}], "left_out": 0}')
        archive.writestr("0/000001.jpg", encode_image(np.zeros((8, 8, 3), np.uint8)))
    return folder / "images.zip"


def _write_database(folder: Path) -> Path:
    with closing(sqlite3.connect(folder / "c.sqlite")) as connection:
        connection.execute("CREATE TABLE alembic_version (version_num VARCHAR(32) NOT NULL)")
        connection.execute("INSERT INTO alembic_version VALUES ('0001')")
        connection.commit()
    return folder / "c.sqlite"


def _read_sweeps(path: Path) -> object:
    return read_argoverse2(path.parent)


def _read_reason(path: Path) -> object:
    reason = Reason.from_note(Note(REASON, path.read_bytes().decode(errors="replace")))
    return reason and describe_reason(reason, reason.others)


TARGETS: Mapping[str, FuzzTarget] = {
    "scenarionet": FuzzTarget(_file("log.pkl", pickle.dumps(description())), read_scenarionet),
    "v2xpnp map": FuzzTarget(_write_map, read_vector_map),
    "v2xpnp frame": FuzzTarget(_file("000000.yaml", v2xpnp_samples.frame()), read_frame),
    "commonroad": FuzzTarget(_write_commonroad, read_commonroad),
    "argoverse2 forecasting": FuzzTarget(_write_forecast, _read_sweeps, native=True),
    "argoverse2 sensor": FuzzTarget(_write_sweeps, _read_sweeps, native=True),
    "argoverse2 map": FuzzTarget(_write_map_archive, _read_sweeps),
    "interaction": FuzzTarget(_write_csv, lambda path: read_interaction(path, path.parent / "map.osm")),
    "opv2v frame": FuzzTarget(
        _file("000068.yaml", opv2v_samples.format_frame(0)), lambda path: read_frame(path, typed=False)
    ),
    "v2v4real frame": FuzzTarget(
        _file("000000.yaml", opv2v_samples.format_real_frame(1)), lambda path: read_frame(path, typed=False)
    ),
    "levelx": FuzzTarget(_write_ground, read_levelx),
    "v2xseq": FuzzTarget(
        lambda folder: v2xseq_samples.write_scene(folder, v2xseq_samples.list_rows(3))[0],
        lambda path: read_v2xseq(path, [path.parents[1] / "maps" / "hdmap1.json"]),
    ),
    "v2xseq map": FuzzTarget(_write_v2xseq_map, read_v2xseq_map),
    "lanelet2": FuzzTarget(_write_osm, read_lanelet2),
    "confirmed infractions": FuzzTarget(
        _file(
            "confirmed.toml",
            '[[confirmed]]\nscenario = "s"\ncav = "c"\nkind = "stop-sign"\ntime_s = 1.5\nfactor = 0.8\n'
            'reason = "rolls"\nby = "me"\n',
        ),
        load_confirmed_infractions,
    ),
    "carla route": FuzzTarget(_file("a_0.xml", EGO), read_route_file),
    "mdrive manifest": FuzzTarget(
        _file(MANIFEST, '{"ego": [{"file": "a_0.xml", "speed": 3}], "npc": []}'),
        lambda path: read_manifest(path.parent),
    ),
    "mdrive behavior": FuzzTarget(
        _file(BEHAVIOR, '{"behaviors": [{"actor_name": "a", "trigger": {"vehicle": "b", "distance_m": 3}}]}'),
        lambda path: read_behaviors(path.parent),
    ),
    "opendrive": FuzzTarget(_file("TownXX.xodr", OPENDRIVE), read_opendrive),
    "recording": FuzzTarget(_write_recording, load_episode),
    "recording header": FuzzTarget(_write_member("header"), _read_member("header")),
    "recording array": FuzzTarget(_write_member("quanta"), _read_member("quanta")),
    "net": FuzzTarget(_write_net, _read_net),
    "network.json": FuzzTarget(
        _file(NETWORK_FILE, (NETWORK / NETWORK_FILE).read_bytes()), lambda path: read_network_file(path.parent)
    ),
    "suite.json": FuzzTarget(_write_suite, lambda path: load_suite(str(path.parent))),
    "scenario.json": FuzzTarget(_write_scenario, load_scenario),
    "results.json": FuzzTarget(_write_results, load_results),
    "journal": FuzzTarget(_write_journal, lambda path: read_run_journal(path.parent)),
    "camera images": FuzzTarget(_write_images, load_camera_tracks),
    "agent config": FuzzTarget(_file("config.json", '{"speed": 3.5, "polite": true, "name": "x"}'), load_agent_config),
    "noted reason": FuzzTarget(
        _file("note.json", Reason(Cause.YIELD, ("k3",), (1.5, -2.0), 9.0, 2.1, 6.6).to_note().text), _read_reason
    ),
    "transcript": FuzzTarget(
        _file("0.jsonl", '{"seed": 0, "ordinal": 0, "digest": "ab", "request": {}, "answer": "yes", "tokens": 3}\n'),
        check_transcript,
    ),
    "archive": FuzzTarget(
        _file("team.zip", archive_samples.packed(archive_samples.GOOD)),
        lambda path: check_archive(path, ArchiveLimits()),
    ),
    "human study plan": FuzzTarget(_file("plan.yaml", json.dumps(human_study.PLAN, indent=1)), load_plan),
    "settings": FuzzTarget(
        _file("server.toml", 'port = 80\n[work]\nprocesses = 0\n[sandbox]\nrequired = ["seccomp"]\n'),
        lambda path: load_settings(path, {}),
    ),
    "database": FuzzTarget(_write_database, lambda path: check_sqlite_file(path, whole=True)),
    "answer of a reader": FuzzTarget(
        _file("answer", encode_value(small_log.recording())),
        lambda path: decode_value(path.read_bytes(), Recording),
        refusals=(TransferError,),
    ),
}
"""By name. A new reader of files gets a line here."""
