"""Collisions that pages are told of: those that begin, once, and those of the recording."""

from pathlib import Path

import pytest
from testing.drives import DriveSession, make_setup, run_drive
from testing.takes import load_recorded

from mdrive_sumo.contract import Control
from mdrive_sumo.core.state import Actors, Contact, Frame, Kind
from server.drive.worker.collision_watch import PAUSE_TICKS, CollisionWatch


def make_frame(tick: int, *contacts: Contact) -> Frame:
    return Frame(tick, {}, Actors.empty(), {}, contacts)


def test_a_contact_is_told_when_it_begins() -> None:
    watch = CollisionWatch()
    walker, wall = Contact("0", "p", Kind.PEDESTRIAN), Contact("0", "", Kind.STATIC)
    prop, cav = Contact("0", "box", Kind.STATIC), Contact("1", "0", Kind.VEHICLE)
    told = watch.find_begun(make_frame(5, walker, cav))
    assert told == [
        {"cav": "0", "with": "pedestrian", "id": "p"},
        {"cav": "1", "with": "vehicle", "id": "0"},
    ]
    assert watch.find_begun(make_frame(6, walker)) == []
    assert watch.find_begun(make_frame(7)) == []
    assert watch.find_begun(make_frame(6 + PAUSE_TICKS, walker)) == [], "bodies that push each other part for a moment"
    told = watch.find_begun(make_frame(7 + PAUSE_TICKS, wall, prop))
    assert [(one["with"], one["id"]) for one in told] == [("wall", ""), ("obstacle", "box")]
    assert watch.find_begun(make_frame(7 + 2 * PAUSE_TICKS, walker))[0]["with"] == "pedestrian"


@pytest.mark.slow
@pytest.mark.usefixtures("in_process")
def test_frames_tell_the_collisions_of_the_recording(suite: Path, tmp_path: Path) -> None:
    """A car that turns off the road until it hits something."""
    told: list[tuple[int, str, str]] = []

    async def drive(session: DriveSession) -> None:
        session._pedals = lambda tick: Control(1.0, 0.0, 0.06 if tick > 30 else 0.0)
        await session.open(make_setup(tmp_path / "drive", suite))
        await session.drive_to(10_000)
        await session.wait_until_ended(1)
        told.extend(
            (frame.tick, one["cav"], one["id"]) for frame in session.frames for one in frame.extra.get("collisions", ())
        )
        await session.close()

    run_drive(drive)
    record = load_recorded(tmp_path / "drive" / "takes" / "1")
    watch = CollisionWatch()
    by_tick: dict[int, list[Contact]] = {}
    for tick, contact in record.contacts:
        by_tick.setdefault(tick, []).append(contact)
    begun = [
        (tick, one["cav"], one["id"])
        for tick, contacts in sorted(by_tick.items())
        for one in watch.find_begun(make_frame(tick, *contacts))
    ]
    assert told == begun
    assert told
