"""Checksums of what the audit log guards but is too long for it: summaries, and results of single scenarios."""

import hashlib
import json
from collections.abc import Iterable, Sequence
from typing import Any

from server.store.tables import JobRow


def compute_checksum(value: Any) -> str:
    """Return the SHA-256 of a JSON value, in hexadecimal."""
    return hashlib.sha256(_encode(value)).hexdigest()


def compute_results_checksum(jobs: Sequence[JobRow]) -> str:
    """Return the SHA-256 of the results of a submission's jobs, ordered by scenario and seed, in hexadecimal."""
    digest = hashlib.sha256()
    for job in jobs:
        digest.update(_encode([job.scenario, job.seed, job.verdict, job.reason, job.result]))
    return digest.hexdigest()


def compute_jobs_checksum(jobs: Iterable[tuple[str, int]]) -> str:
    """Return the SHA-256 of the scenarios and seeds that a submission is driven in, in hexadecimal."""
    return compute_checksum(sorted([scenario, seed] for scenario, seed in jobs))


def _encode(value: Any) -> bytes:
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False).encode()
