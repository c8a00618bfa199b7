"""What images show against the exact line of sight: `make test` takes a sample of the 1 000 frames."""

from collections import Counter

import pytest
from testing.camera_scenes import needs_opengl
from testing.visible_instances import FRAMES_OF_NETWORK, NETWORKS, Agreement, count_agreements

pytestmark = [needs_opengl, pytest.mark.slow]
FRAMES = FRAMES_OF_NETWORK * len(NETWORKS)
SAMPLE = range(0, 2 * FRAMES_OF_NETWORK, 5)


def check_agreements(found: Counter[Agreement], frames: int, least: float) -> None:
    """At least a share agrees, and nothing else happens without a reason."""
    pairs = found.total()
    assert pairs >= 2 * frames, found
    assert min(found[Agreement.BOTH], found[Agreement.NEITHER]) >= frames // 2, found
    assert found[Agreement.BOTH] + found[Agreement.NEITHER] >= least * pairs, found
    assert not found[Agreement.UNEXPLAINED], found


def test_a_sample_of_images_shows_what_is_in_line_of_sight() -> None:
    """Of two networks; two of about 200 pairs may differ by chance, and one more."""
    check_agreements(count_agreements(SAMPLE), len(SAMPLE), 0.98)


@pytest.mark.full
def test_a_thousand_images_show_what_is_in_line_of_sight() -> None:
    check_agreements(count_agreements(range(FRAMES)), FRAMES, 0.99)
