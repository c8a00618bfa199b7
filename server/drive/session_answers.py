"""What browsers are told of a drive: the welcome, the tree of takes, the ghosts of a what-if."""

from collections.abc import Mapping

from server.drive.messages import CavOut, DriverChangeOut, GhostOut, TakeOut, WelcomeOut
from server.drive.session_rules import SessionRules
from server.drive.simulation_process import SimulationProcess
from server.drive.simulation_values import DriveFrame, WhatIfBranch
from server.drive.take_tree import Take, TakeTree


def build_welcome(
    simulation: SimulationProcess,
    rules: SessionRules,
    cav: str,
    frame: DriveFrame | None,
    cavs: Mapping[str, tuple[str, bool]],
) -> WelcomeOut:
    """Return the first message to a browser.

    cav: its CAV; "" for spectators. frame: the last one. cavs: driver by CAV, and whether its person is there.
    """
    facts = simulation.facts
    shown = cav or facts.cavs[0]
    return WelcomeOut(
        role="driver" if cav else "spectator",
        cav=cav or None,
        scenario=facts.scenario,
        description=facts.description,
        origin=facts.origin,
        route=facts.routes[shown],
        routes=dict(facts.routes),
        speed_limits=facts.speed_limits[shown],
        room=facts.room[shown],
        vehicle=dict(facts.vehicle),
        pseudonyms=dict(facts.pseudonyms),
        tick_s=facts.tick_s,
        most_ticks=max(facts.time_limit_ticks.values()),
        time_limit_ticks=dict(facts.time_limit_ticks),
        agents=list(facts.agents),
        cavs=[CavOut(id=one, driver=driver, is_connected=there) for one, (driver, there) in cavs.items()],
        weather=facts.weather,
        v2x_view=rules.v2x_view,
        chat=rules.chat,
        may_rewind=rules.may_rewind,
        may_hand_over=rules.may_hand_over,
        return_path=rules.return_paths.get(cav, ""),
        takes=list_takes(simulation.tree, frame),
    )


def list_takes(tree: TakeTree, frame: DriveFrame | None) -> list[TakeOut]:
    """Return the takes as the page shows them. frame: the last of the live take, which tells how far that has come."""
    return [
        TakeOut(
            number=take.number,
            parent=take.parent,
            tick=take.tick,
            drivers=dict(take.drivers),
            changes=[DriverChangeOut(tick=one.tick, cav=one.cav, driver=one.driver) for one in take.changes],
            status=str(take.status),
            end_tick=_find_end(take, frame),
            left_tick=take.left_tick,
            score=take.score,
            ds=dict(take.ds),
            losses=dict(take.losses),
            folder=str(tree.find_folder(take.number).relative_to(tree.folder)),
        )
        for _, take in sorted(tree.takes.items())
    ]


def _find_end(take: Take, frame: DriveFrame | None) -> int:
    """Return the last tick of a take that is known."""
    if take.end_tick is not None:
        return take.end_tick
    if frame is not None and frame.take == take.number:
        return max(take.tick, frame.tick)
    return take.tick if take.left_tick is None else take.left_tick


def list_ghosts(branch: WhatIfBranch) -> list[GhostOut]:
    """Return a what-if branch as one ghost for each CAV."""
    return [
        GhostOut(
            agent=branch.agent,
            cav=cav,
            poses=[(round(x, 2), round(y, 2), round(yaw, 3)) for x, y, yaw, _ in track],
            ending=branch.endings.get(cav),
        )
        for cav, track in branch.tracks.items()
    ]
