"""SessionRules: what people may do in a drive beside driving."""

from collections.abc import Mapping
from dataclasses import dataclass, field

PAUSE = "pause"
"""`SessionRules.on_disconnect`: the clock waits for the lost driver."""
PATIENCE_S = 60.0
"""How long a lost driver may take to come back [s]. A minute: a page is loaded anew, a phone finds its network."""


@dataclass(frozen=True, slots=True)
class SessionRules:
    """What people may do in a drive, beside driving: conditions of a study switch some of it off."""

    on_disconnect: str = PAUSE
    """`PAUSE`, or the agent that drives on for a lost driver."""
    chat: bool = True
    v2x_view: bool = True
    """Whether people see what CAM, CPM and MCM tell."""
    may_rewind: bool = True
    """Whether people may go back, and ask what agents would have done."""
    may_hand_over: bool = True
    may_pause: bool = True
    patience_s: float = PATIENCE_S
    return_paths: Mapping[str, str] = field(default_factory=dict[str, str])
    """Where the page leads once the drive has ended, by CAV: back to the study that the drive is part of."""
