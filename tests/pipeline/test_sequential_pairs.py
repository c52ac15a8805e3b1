from itertools import combinations

import numpy as np
import pytest

from omnisight.pipeline.reconstruction.reconstruct import _near_pairs


@pytest.mark.parametrize("window", [1, 3, 100])
def test_near_pairs_are_those_of_frames_within_the_window(window):
    frame = np.random.default_rng(window).integers(0, 12, 20)
    expected = [(a, b) for a, b in combinations(range(20), 2) if abs(frame[a] - frame[b]) <= window]
    assert sorted(_near_pairs(frame, window)) == expected
