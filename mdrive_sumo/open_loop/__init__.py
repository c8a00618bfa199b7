"""Open loop: agents see the frames of a recorded drive, and their plans and detections are compared with it."""

from mdrive_sumo.open_loop.detection_precision import DetectionCounts, compute_average_precision
from mdrive_sumo.open_loop.evaluate_open import (
    OPEN_LOOP_FILE,
    OpenLoopExecutor,
    evaluate_open,
    make_open_loop_executor,
)
from mdrive_sumo.open_loop.open_loop_run import OpenLoopRun, prepare_open_loop
from mdrive_sumo.open_loop.reference import (
    LOG,
    REFERENCE_AGENT,
    Reference,
    find_reference,
    open_log_reference,
    open_run_reference,
)
from mdrive_sumo.open_loop.results import OpenLoopResults, OpenLoopScenario

__all__ = [
    "LOG",
    "REFERENCE_AGENT",
    "OPEN_LOOP_FILE",
    "DetectionCounts",
    "OpenLoopExecutor",
    "OpenLoopResults",
    "OpenLoopRun",
    "OpenLoopScenario",
    "Reference",
    "compute_average_precision",
    "evaluate_open",
    "find_reference",
    "open_log_reference",
    "open_run_reference",
    "make_open_loop_executor",
    "prepare_open_loop",
]
