"""Sequences of image files."""

import numpy as np
import pytest

import omnisight as om
from omnisight.pipeline.odometry.frame_sequence import FrameSequence


@pytest.mark.parametrize("cameras", [(), ("left", "right")])
def test_times_are_those_of_a_list_of_the_tum_data_sets(tmp_path, cameras):
    seconds = (4.5, 4.75, 5.25)
    for camera in cameras or (".",):
        (tmp_path / camera / "images").mkdir(parents=True)
        for k in range(3):
            om.write_image(tmp_path / camera / "images" / f"{k}.png", np.zeros((20, 40), np.uint8))
        rows = [f"{time} images/{k}.png" for k, time in enumerate(seconds)]
        (tmp_path / camera / "images.txt").write_text("\n".join(["# images of a camera", "#timestamp filename", *rows]))
    assert FrameSequence.open(tmp_path, cameras, om.OdometryOptions()).times == seconds
    assert FrameSequence.open(tmp_path, cameras, om.OdometryOptions(fps=5)).times == (0, 0.2, 0.4)
    for camera in cameras or (".",):
        (tmp_path / camera / "images.txt").write_text("1 1 0 0 0 0 0 0 1 images/0.png\n")  # of COLMAP
    assert FrameSequence.open(tmp_path, cameras, om.OdometryOptions()).times == (0, 0.1, 0.2)


def test_the_name_of_a_camera_chooses_its_images_of_the_data_set_of_a_rig(tmp_path):
    for camera in ("front", "back"):
        for folder in (".", "images", "depth"):
            (tmp_path / camera / folder).mkdir(parents=True, exist_ok=True)
            om.write_image(tmp_path / camera / folder / "0.png", np.zeros((20, 40), np.uint8))
    sequence = FrameSequence.open(tmp_path, (), om.OdometryOptions(name="front"))
    assert sequence.paths == [tmp_path / "front" / "images" / "0.png"]
    sequence = FrameSequence.open(tmp_path, (), om.OdometryOptions(name="a camera without a folder"))
    assert sequence.paths == [tmp_path / name / "images" / "0.png" for name in ("back", "front")]


def test_times_belong_to_the_names_of_symbolic_links(tmp_path):
    (tmp_path / "links").mkdir()
    for k in range(3):
        om.write_image(tmp_path / f"{k}.png", np.zeros((20, 40), np.uint8))
        (tmp_path / "links" / f"image{k}.png").symlink_to(tmp_path / f"{k}.png")
    (tmp_path / "links" / "times.csv").write_text("".join(f"image{k}.png,{k / 4}\n" for k in range(3)))
    sequence = FrameSequence.open(tmp_path / "links", (), om.OdometryOptions())
    assert sequence.times == pytest.approx([0, 0.25, 0.5])
