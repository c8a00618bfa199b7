"""The hostile suite through the door of a real server: uploads over HTTP, boxes, verdicts, and nothing left behind.

All in one test: the server, its workers and the environment are the same for all, and serve on when it is over.
"""

import hashlib
import json
import logging
import re
import socket
import time
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import pytest
from hostile.served import ABUSES, PROGRAMS, SERVED, Served, page
from hostile.teams import MARKER, blabber, drivers, with_abuse, with_program, with_set_uid_program
from sqlalchemy import select
from testing.archive_samples import GOOD, packed, with_entry
from testing.hostile_server import Door, Watch, serving, told
from testing.paths import ROOT
from testing.processes import wait_for
from testing.sandbox_runs import AGENTS

from mdrive_sumo.agent_process.sandbox import examine_layers
from mdrive_sumo.agent_process.sandbox.box_spec import SLOTS
from mdrive_sumo.agent_process.sandbox.user_slots import FIRST_UID
from mdrive_sumo.episode.recorder import MAX_KINDS
from mdrive_sumo.runs.fingerprint import compute_code_checksum
from server.enums import MIN_HIDDEN_SCENARIOS
from server.settings import SandboxSettings
from server.store import Store
from server.store.tables import AuditEntryRow, JobRow
from tests.server.archive.test_archive import BAD

LOG = logging.getLogger(__name__)
"""`-o log_cli_level=INFO` shows how fast the server answered meanwhile."""
PAGE = ROOT / "docs" / "sandbox-hostile.md"
SAMPLE = ROOT / "server" / "samples" / "agent"
FEW = (
    *("net", "files", "setuid", "procs", "forkbomb", "membomb", "membomb_fork", "diskfill", "stdoutflood", "daemon"),
    *("segv", "diary", "impostor", "never", "huge", "early", "malformed", "result", "exit", "terminal", "privileged"),
    *("gossip", "archivist", "labeller", "joint-sleeper", "until-a-date"),
)
"""Each way out of a box and each verdict; all of them meet the same boxes, without a server, in `make test`."""
DATE_S = 80.0
"""After which one agent changes its ways; it is driven long before."""
SENTENCE = re.compile(r"[^\n]{10,400}")


def need_layers() -> None:
    reasons = {"namespaces": "needs bubblewrap", "uid": "needs root", "cgroup": "needs control groups"}
    missing = set(SandboxSettings().required) - {layer.name for layer in examine_layers() if layer.active}
    if missing:
        pytest.skip(next((why for name, why in reasons.items() if name in missing), "needs bubblewrap"))


@pytest.mark.full
@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("names", [FEW, tuple(SERVED)], ids=["few", "all"])
def test_hostile_server(names: Collection[str], tmp_path: Path) -> None:
    need_layers()
    served = {name: SERVED[name] for name in names}
    code = compute_code_checksum()
    with socket.socket(socket.AF_UNIX) as local, serving(tmp_path) as door:
        name = f"mdrive-test-{tmp_path.stat().st_ino}"
        local.bind(f"\0{name}")
        local.listen()
        before, date_s = given(tmp_path), time.time() + DATE_S
        with Watch(door) as watch:
            agents = agents_of(door, tmp_path, date_s, name)
            assert agents.keys() == SERVED.keys()
            send_all(door, {name: agents[name] for name in served})
            LOG.info("agents sent")
            refuse_archives(door)
            LOG.info("archives refused")
            found = door.finished()
        LOG.info("all driven")
        check_verdicts(door, found, served)
        check_what_was_told(door, served)
        check_hidden(door)
        check_nothing_is_left(door)
        LOG.info("nothing left")
        check_date(door, date_s)
        LOG.info("spot checks done")
        check_honest(door)
    LOG.info(watch.told())
    assert watch.failures == [] and len(watch.seconds) > 20, watch.told()
    assert (compute_code_checksum(), given(tmp_path)) == (code, before)


def agents_of(door: Door, folder: Path, date_s: float, local: str) -> Mapping[str, bytes]:
    """The archive of each agent of the table; the one that waits for a date comes first."""
    arguments = {
        "net": (door.address.rpartition(":")[2], local),
        "files": tuple(map(str, (folder / MARKER / MARKER / "scenario.json", door.data / "challenge.sqlite", folder))),
    }
    programs = {name: with_program(name, *arguments.get(name, ())) for name in PROGRAMS if name != "setuid"}
    abuses = {name: with_abuse(name, folder) for name in ABUSES}
    return {**drivers(date_s), **programs, "setuid": with_set_uid_program(), **abuses}


def send_all(door: Door, agents: Mapping[str, bytes]) -> None:
    for name in ("until-a-date", *(name for name in agents if name != "until-a-date")):
        answer = door.send(name, agents[name])
        assert answer.status_code == 201, (name, answer.text)
    assert door.send("diary-twice", with_program("diary"), phase="twice").status_code == 201
    for name in ("spy-1", "spy-2"):
        assert door.send(name, blabber(), phase="secret", who="spy").status_code == 201


def refuse_archives(door: Door) -> None:
    """Bad ones get a sentence and leave nothing; those that are harmless are taken."""
    before = archives(door)
    for name, (data, _) in BAD.items():
        answer = door.send(name, data, who="honest")
        status = 413 if name == "too large" else 422
        found = answer.json()
        assert (answer.status_code, found["status"]) == (status, status), (name, answer.text)
        assert found["type"] == f"urn:mdrive-sumo:problem:{'too-large' if status == 413 else 'archive'}", (name, found)
        assert SENTENCE.fullmatch(found["detail"]), (name, found)
    assert archives(door) == before
    assert door.ask("/phases/once/quota", "honest").json()["in_total"] == 0


def archives(door: Door) -> set[str]:
    return {path.name for path in (door.data / "archives").iterdir()}


def check_verdicts(door: Door, found: Mapping[str, Mapping[str, Any]], served: Mapping[str, Served]) -> None:
    """Each is in the table, and none has a failure of ours."""
    jobs = jobs_of(door)
    got = {name: verdict(found[name], jobs[name][0]) for name in served}
    assert got == {name: each.verdict for name, each in served.items()}
    for name, each in served.items():
        job = jobs[name][0]
        reason = found[name]["why"] if each.verdict == "rejected" else job.result["egos"][0]["reason"]
        said = reason.partition(": ")[2] if each.verdict.startswith("agent-failed") else reason
        assert said.startswith(each.says) and (said or not each.says), (name, reason)
        for box in (job.usage or {}).get("boxes", {}).values():
            assert box["clean"] and box["oom_killed"] == each.oom, (name, box)
            assert each.answers in (None, box["answers"]), (name, box)
    assert {job.verdict for each in jobs.values() for job in each} <= {"ok", "agent-failed", None}
    assert all(job.attempt == 1 for each in jobs.values() for job in each if job.verdict)
    assert door.runs("impostor")[0]["ds"] == 0.0
    assert [door.runs(name)[0]["recording"] for name in ("archivist", "gossip", "impostor")] == [True, False, True]
    notes = jobs["labeller"][0].result["notes"]
    assert len(notes) == MAX_KINDS + 1 and notes["(dropped)"] > 1000
    assert all(len(json.dumps(job.result)) < 10_000 for each in jobs.values() for job in each if job.result)


def verdict(submission: Mapping[str, Any], job: JobRow) -> str:
    if submission["state"] != "done":
        return submission["state"]
    return str(job.verdict) if job.reason is None else f"{job.verdict} ({job.reason})"


def jobs_of(door: Door) -> dict[str, list[Any]]:
    """What the database holds of each submission; the API does not tell all of it."""
    store = Store(f"sqlite:///{door.data / 'challenge.sqlite'}")
    with store.read() as session:
        every = {
            name: list(session.scalars(select(JobRow).where(JobRow.submission == id_)))
            for name, id_ in door.sent.items()
        }
        session.expunge_all()
    store.close()
    return every


def check_what_was_told(door: Door, served: Mapping[str, Served]) -> None:
    """The programs found what the table says, by their own logs, which are short."""
    for name, each in served.items():
        if name not in PROGRAMS:
            continue
        log = door.log(name)
        assert len(log) <= SandboxSettings().log_bytes, name
        found = told(log)
        assert {key: found.get(key) for key in each.told} == dict(each.told), (name, found)
    assert door.log("stdoutflood").startswith("xxx")
    for seed in (0, 1):  # the same agent, before and after, also in the other phase
        assert told(door.log("diary-twice", seed)) == {"found": [], "kept": ["/tmp", "/dev/shm"]}


def check_hidden(door: Door) -> None:
    """An agent knows where it is in a hidden scenario. Nothing of that reaches its team."""
    route = "-26.498"
    own = [f"/submissions/{door.sent[name]}" for name in ("spy-1", "spy-2")]
    paths = [*own, *(f"{path}/scenarios" for path in own), "/submissions", "/phases", "/leaderboards/secret"]
    paths += [f"{own[0]}/scenarios/{MARKER}/0/{what}" for what in ("recording", "replay", "logs/0")]
    answers = [door.ask(path, "spy") for path in paths] + [door.ask(path) for path in paths]
    with door.http.stream("GET", f"{own[0]}/events", headers={"Authorization": f"Bearer {door.tokens['spy']}"}) as all_:
        events = "".join(all_.iter_text())
    for text in (*(answer.text for answer in answers), events):
        assert route not in text and "marker" not in text.replace(f"'{MARKER}'", ""), text
    assert not [path for name in ("spy-1", "spy-2") for path in (door.data / "recordings").glob(f"{door.sent[name]}*")]
    assert [job.reason for job in jobs_of(door)["spy-1"]] == ["crashed"] * MIN_HIDDEN_SCENARIOS
    assert route in str(jobs_of(door)["spy-1"][0].result), "it knew, so it could have told"


def check_nothing_is_left(door: Door) -> None:
    """No process, no file but the server's own, archives as they were sent, the audit log whole."""
    end_s = time.monotonic() + 10.0
    while (left := processes_of(door)) and time.monotonic() < end_s:
        time.sleep(0.1)
    assert left == []
    allowed = (
        r"serve\.lock|challenge\.sqlite.*|archives/[0-9a-f]{64}\.zip|unpacked/[0-9a-f]{64}/(manifest\.json|agent/.*)|"
    )
    allowed += r"environments/.*|recordings/[0-9a-f]{32}/\d/short(\.npz|\.(0|all)\.log)"
    files = [path for path in door.data.rglob("*") if not path.is_dir()]
    names = [str(path.relative_to(door.data)) for path in files]
    assert [name for name in names if not re.fullmatch(allowed, name)] == []
    foreign = range(FIRST_UID, FIRST_UID + SLOTS)
    shared = [path for home in ("/tmp", "/var/tmp", "/dev/shm", "/run") for path in Path(home).iterdir()]
    assert [path for path in (*files, *shared) if owner(path) in foreign] == []
    assert list(Path("/run/mdrive-sumo").iterdir()) == []
    assert [path for path in door.scratch.rglob("*") if not path.is_dir()] == []
    for path in (door.data / "archives").iterdir():
        assert hashlib.sha256(path.read_bytes()).hexdigest() == path.stem
    assert door.ask("/audit", "admin").json()["broken"] is None


def given(folder: Path) -> dict[Path, bytes]:
    """What a server reads and no agent may write."""
    paths = (folder / "server.toml", *folder.glob("*/suite.json"), *folder.glob("*/*/scenario.json"))
    return {path: path.read_bytes() for path in paths}


def processes_of(door: Door) -> list[str]:
    """Processes of boxes in which something of this server is mounted (others may run boxes here, too)."""
    left: list[str] = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            mounts, uid = (entry / "mountinfo").read_text(), entry.stat().st_uid
            if uid in range(FIRST_UID, FIRST_UID + SLOTS) and str(door.data) in mounts:
                left.append((entry / "cmdline").read_text().replace("\0", " "))
        except OSError:
            continue
    return left


def owner(path: Path) -> int:
    try:
        return path.lstat().st_uid
    except FileNotFoundError:
        return 0


def check_date(door: Door, date_s: float) -> None:
    """What a date changes, a spot re-run shows; an agent that does the same twice is not blamed."""
    time.sleep(max(0.0, date_s - time.time()))
    checked = door.admin("verify", door.sent["until-a-date"], door.sent["diary"])
    lines = {line.split()[0]: line for line in checked.stdout.splitlines()}
    assert checked.returncode == 1, checked.stdout + checked.stderr
    assert "digest" in lines[door.sent["until-a-date"]] and ", was " in lines[door.sent["until-a-date"]]
    assert lines[door.sent["diary"]].endswith("identical")
    walked = door.admin("audit")
    assert walked.returncode == 0 and "entries, head" in walked.stdout, walked.stderr
    assert flagged(door) == [door.sent["until-a-date"]]


def flagged(door: Door) -> list[str]:
    """Submissions that a spot re-run found to differ, by the audit log."""
    store = Store(f"sqlite:///{door.data / 'challenge.sqlite'}")
    with store.read() as session:
        entries = session.scalars(select(AuditEntryRow).where(AuditEntryRow.action == "spot-check")).all()
        found = [entry.data["submission"] for entry in entries if not entry.data["same"]]
    store.close()
    return found


def check_honest(door: Door) -> None:
    """After all that the sample agent drives, and harmless oddities of archives are taken."""
    files = {str(path.relative_to(SAMPLE)): path.read_bytes() for path in SAMPLE.rglob("*") if path.is_file()}
    odd = {"zip-in-zip": with_entry("weights/inner.zip", packed({"../../x": b"x"})), "good": packed(GOOD)}
    odd["nul-in-name"] = with_entry("src/a.py_b").replace(b"src/a.py_b", b"src/a.py\0b")
    for name, data in {"sample": packed(files), **odd}.items():
        assert door.send(name, data, who="honest").status_code == 201, name
    found = door.finished()
    assert [(job.verdict, job.failure) for job in jobs_of(door)["sample"]] == [("ok", "")]
    assert found["sample"]["summary"]["overall"]["rc"] == 100.0

    def is_ranked() -> bool:
        return "honest" in [row["team"] for row in door.ask("/leaderboards/once").json()["rows"]]

    wait_for(is_ranked, 30)  # boards are computed beside, shortly after a result


def test_the_page_shows_the_table() -> None:
    assert page() in PAGE.read_text()


def test_the_table_has_every_program() -> None:
    assert {path.stem for path in AGENTS.glob("*.py")} == PROGRAMS.keys() | {"spin", "good", "tell", "relay"}
