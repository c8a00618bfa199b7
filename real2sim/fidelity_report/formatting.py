"""Text of the report: figures with their units, failed checks and cleaning changes as phrases."""

from real2sim.clean.cleaning_report import ChangeReason, TrackChange
from real2sim.quality import CHECKS
from real2sim.quality.actor_quality import ActorQuality

FIGURES: dict[str, tuple[str, str, int]] = {
    "jumps_1m": ("jumps over 1 m", "", 0),
    "jerk_p95": ("jerk, 95th percentile", "m/s³", 1),
    "acceleration_max": ("highest acceleration", "m/s²", 1),
    "speed_max": ("highest speed", "m/s", 1),
    "yaw_step_max_deg": ("yaw change within one frame", "°", 0),
    "yaw_second_max_deg": ("yaw change within one second", "°", 0),
    "curvature_spread": ("spread of the curvature change", "1/m", 3),
    "backward_max": ("moved against its heading in one frame", "m", 2),
    "error_median": ("median distance to the log", "m", 2),
    "error_p95": ("distance to the log, 95th percentile", "m", 2),
    "lateral_shift_max": ("lateral shift from the log", "m", 2),
    "dtw_mean": ("mean distance to the log, time warped", "m", 2),
    "turn_change_deg": ("difference of the turning angle to the log", "°", 0),
    "lateral_mean": ("mean distance to the centre line", "m", 2),
    "off_route_frames": ("frames over 3 m from any lane", "", 0),
    "wrong_way_frames": ("frames against the direction of the lane", "", 0),
}
"""Label, unit and decimals of every figure that a check uses."""

CLEANING_ACTIONS: dict[ChangeReason, str] = {
    ChangeReason.DUPLICATE: "one object under several ids, merged",
    ChangeReason.ID_FLIP: "an id that switched to another object, corrected",
    ChangeReason.TELEPORT: "positions that no motion explains, removed or interpolated",
    ChangeReason.EGO_GHOST: "a second track of a CAV, merged with it",
    ChangeReason.HEADING: "headings reversed, or derived from motion",
    ChangeReason.GAP: "missing frames, filled",
    ChangeReason.LONG_GAP: "gaps too long to fill, left open",
    ChangeReason.SIZE: "inconsistent or unknown sizes, made consistent",
    ChangeReason.LABEL: "categories that contradict each other or the motion, corrected",
    ChangeReason.STATIC: "objects that never move, fixed at one position",
    ChangeReason.OVERLAP: "objects that appear inside others: they begin later or become smaller",
    ChangeReason.INSIDE: "objects that overlap others most of the time, removed",
    ChangeReason.TOO_SHORT: "tracks too short to be used, removed",
}
"""What each reason of cleaning means and what was done."""


def format_figure(value: float | None, unit: str = "", decimals: int = 2) -> str:
    """Return a figure with its unit; a dash if there is none."""
    if value is None:
        return "–"
    decimals += decimals == 2 and 0 < abs(value) < 0.01
    if decimals == 3 and 0 < abs(value) < 0.0005:
        return f"< 0.001{f' {unit}' if unit else ''}"
    return f"{value:.{decimals}f}{'' if unit in ('', '°', '%') else ' '}{unit}"


def format_share(value: float | None) -> str:
    """Return a share in percent."""
    return "–" if value is None else f"{100 * value:.1f} %"


def describe_figure(figure: str) -> tuple[str, str, int]:
    """Return label, unit and decimals of a figure."""
    return FIGURES.get(figure, (figure, "", 2))


def describe_failures(actor: ActorQuality) -> list[str]:
    """Return a phrase for each failed check with its figure and limit."""
    limits = {check.figure: check.get_limit(actor) for check in CHECKS}
    return [_describe_failure(name, getattr(actor, name, None), limits.get(name)) for name in actor.failed]


def _describe_failure(name: str, value: float | None, limit: float | None) -> str:
    words, unit, decimals = describe_figure(name)
    while decimals < 4 and limit is not None and value is not None and round(value, decimals) <= limit < value:
        decimals += 1  # rounding must not show a figure just above its limit as equal to it
    allowed = "" if limit is None else f" (at most {limit:g}{'' if unit in ('', '°') else ' '}{unit})"
    return f"{words}: {format_figure(value, unit, decimals)}{allowed}"


def format_change(change: TrackChange) -> str:
    """Return a phrase for a change that cleaning made."""
    return f"{change.reason.value}, {format_frames(change.frames)}{': ' if change.detail else ''}{change.detail}"


def format_frames(count: int) -> str:
    """Return a number of frames with its noun."""
    return f"{count} frame{'' if count == 1 else 's'}"
