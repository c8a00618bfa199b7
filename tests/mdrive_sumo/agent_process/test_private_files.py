"""Files of a box's own: copied once for a slot, complete or absent, and never what the box should not see."""

import os
import shutil
from pathlib import Path

import pytest
from testing.sandbox_runs import PATIENCE_S, SMALL, needs_bubblewrap, own_slot, reachable

from mdrive_sumo.agent_process.sandbox import BoxSpec, open_box
from mdrive_sumo.agent_process.sandbox.layers import find_program
from mdrive_sumo.agent_process.sandbox.private_files import MEMORY, remove_idle_files
from mdrive_sumo.core.errors import InputError

pytestmark = [
    needs_bubblewrap,
    pytest.mark.slow,
    pytest.mark.skipif(os.geteuid() != 0, reason="needs root"),
]

SLOT = own_slot()


def test_a_slots_copies_are_kept_for_the_next_box_and_renewed_with_the_files(tmp_path: Path) -> None:
    agent = reachable(tmp_path) / "agent"
    agent.mkdir()
    (agent / "text").write_text("one")
    place = tmp_path / "copies"
    place.mkdir()
    spec = BoxSpec(("/bin/sh", "-c", "cat /agent/text"), {agent: "/agent"}, slot=SLOT, copies=place, limits=SMALL)

    def look() -> tuple[bytes, set[int]]:
        with open_box(spec) as box:
            box.ready(PATIENCE_S)
            box.close()
        return box.log(), {path.stat().st_ino for path in place.rglob("cat")}

    first, again = look(), look()
    assert first == again == (b"one", first[1])
    assert (agent / "text").stat().st_ino not in {path.stat().st_ino for path in place.rglob("text")}
    (agent / "text").unlink()
    (agent / "text").write_text("two, longer")
    assert look()[0] == b"two, longer"
    remove_idle_files(place)
    assert [path.name for path in place.rglob("*")] == ["mdrive-sumo-files-0"]


def test_files_of_one_folder_are_one_mount_unless_something_else_is_mounted_there(tmp_path: Path) -> None:
    """Each mount costs the box's start; a mount inside a read-only one would fail."""
    shown, place = reachable(tmp_path) / "shown", tmp_path / "copies"
    place.mkdir()
    for name in ("a", "b", "live"):
        (shown / name).mkdir(parents=True)
        (shown / name / "text").write_text(name)
    look = "cat /kit/x/*/text; (: >/kit/x/mine); (: >/kit/x/a/mine); echo done >&3; read wait <&3"
    parts = {shown / "a": "/kit/x/a", shown / "b": "/kit/x/b"}
    for more, expected, count in (({}, b"ab", 1), ({shown / "live": "/kit/x/live"}, b"ablive", 3)):
        live = frozenset(more.values())
        command = ("/bin/sh", "-c", look)
        with open_box(BoxSpec(command, parts | more, slot=SLOT, copies=place, limits=SMALL, live=live)) as box:
            box.ready(PATIENCE_S)
            mounts = Path(f"/proc/{find_program(box.pid)}/mountinfo").read_text()
            box.close()
        log = box.log()
        assert log.startswith(expected) and log.count(b"Read-only file system") == 2, log
        assert mounts.count(" /kit") == count
        inodes = {path.stat().st_ino for name in ("a", "b") for path in (shown / name).iterdir()}
        assert inodes.isdisjoint(path.stat().st_ino for path in place.rglob("text"))
    remove_idle_files(place)


@pytest.mark.parametrize("is_finished", [True, False])
def test_a_half_removed_copy_is_never_used(is_finished: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A process that is killed while it removes copies leaves no copy under its name."""
    place, kill = reachable(tmp_path) / "copies", KeyboardInterrupt
    place.mkdir()
    spec = BoxSpec(("/bin/sh", "-c", "echo whole"), {}, slot=SLOT, copies=place, limits=SMALL)

    def remove_one_file(path: Path) -> None:
        next(each for each in path.rglob("*") if each.is_symlink() or each.is_file()).unlink()
        raise kill

    with open_box(spec) as box:
        box.ready(PATIENCE_S)
    with monkeypatch.context() as killed, pytest.raises(kill):
        killed.setattr(shutil, "rmtree", remove_one_file)
        remove_idle_files(place)
    names = [path.name for path in place.glob("*/*/*")]
    assert len(names) == 1 and names[0].startswith(".old-system-")
    if is_finished:
        with open_box(spec) as box:
            box.ready(PATIENCE_S)
        assert box.log() == b"whole\n"
    remove_idle_files(place)
    assert not list(place.glob("*/*"))


def test_no_room_for_the_copies_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=0))
    with pytest.raises(InputError, match=r"sandbox: expected \d+ MiB free in .* found 0 MiB; make it larger"):
        open_box(BoxSpec(("/bin/true",), {}, slot=SLOT, copies=tmp_path))
    with pytest.raises(InputError, match="absent, for the files of boxes"):
        open_box(BoxSpec(("/bin/true",), {}, slot=SLOT, copies=Path("/proc/absent")))


def test_what_a_box_is_told_of_the_host_stays_files_that_it_may_read(tmp_path: Path) -> None:
    """Permissions are copied, links too, hidden folders are left out, what the caller writes meanwhile is seen."""
    shown = reachable(tmp_path) / "shown"
    (shown / "secret").mkdir(parents=True)
    (shown / "secret" / "route").write_text("A to B")
    (shown / "closed").write_text("closed")
    (shown / "closed").chmod(0o600)
    (shown / "link").symlink_to("open")
    (shown / "open").write_text("open ")
    frames = tmp_path / "frames"
    frames.mkdir()
    text = "cat /shown/link /shown/closed; ls /shown/secret; read line <&3; cat /frames/now"
    spec = BoxSpec(
        ("/bin/sh", "-c", text),
        {shown: "/shown", frames: "/frames"},
        slot=SLOT,
        copies=MEMORY,
        live=frozenset({"/frames"}),
        hidden=(shown / "secret",),
    )
    with open_box(spec) as box:
        (frames / "now").write_text("frame")
        (frames / "now").chmod(0o644)
        box.socket.sendall(b"go\n")
        box.ready(PATIENCE_S)
        box.close()
    assert box.log() == b"open cat: /shown/closed: Permission denied\nframe"
    assert not list((MEMORY / "mdrive-sumo-files-0" / str(SLOT)).rglob("route"))
    remove_idle_files(MEMORY, (SLOT,))
