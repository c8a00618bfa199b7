"""The logged drive of a log's CAVs, judged by the scorer of live episodes."""

from real2sim.logged_drive.confirmed_infractions import ConfirmedInfraction, load_confirmed_infractions
from real2sim.logged_drive.logged_drive import LoggedCav, LoggedDrive, LoggedInfraction, score_logged_drive
from real2sim.logged_drive.logged_episode import record_log

__all__ = [
    "ConfirmedInfraction",
    "LoggedCav",
    "LoggedDrive",
    "LoggedInfraction",
    "load_confirmed_infractions",
    "record_log",
    "score_logged_drive",
]
