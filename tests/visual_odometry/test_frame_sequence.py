"""Sequences of image files."""

import numpy as np
import pytest

import omnisight as om
from omnisight.pipeline.odometry.frame_sequence import FrameSequence


def test_times_belong_to_the_names_of_symbolic_links(tmp_path):
    (tmp_path / "links").mkdir()
    for k in range(3):
        om.write_image(tmp_path / f"{k}.png", np.zeros((20, 40), np.uint8))
        (tmp_path / "links" / f"image{k}.png").symlink_to(tmp_path / f"{k}.png")
    (tmp_path / "links" / "times.csv").write_text("".join(f"image{k}.png,{k / 4}\n" for k in range(3)))
    sequence = FrameSequence.open(tmp_path / "links", (), om.OdometryOptions())
    assert sequence.times == pytest.approx([0, 0.25, 0.5])
