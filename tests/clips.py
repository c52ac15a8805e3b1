"""A rendered clip of a board that is carried about before a fisheye lens, for the tests of clips."""

from functools import cache

import cv2
import numpy as np

from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.simulation import BoardInScene, fisheye_setup
from omnisight.targets import Checkerboard

BOARD = Checkerboard(9, 6, 0.04)
SETUP = fisheye_setup(480)
PLACES, HELD, CARRIED, EMPTY = 8, 8, 5, 12


@cache
def carried():
    """Give the frames (H, W, 3) RGB and for each the place that the board is held at, or "carried", or "empty"."""
    renderer, rng, middle = SETUP.renderer(samples=1), np.random.default_rng(3), BOARD.points.mean(0)
    poses = [held.cam_from_board for held in SETUP.boards(PLACES, BOARD)]
    seconds = [*poses[1:], poses[0]]

    def shot(pose):
        return renderer([BoardInScene(BOARD, pose)], noise=0).image.astype(np.float32)

    def between(a, b, share):
        turn = a.rotation @ so3.exp(share * so3.log(a.rotation.T @ b.rotation))
        return Pose(turn, (1 - share) * (a @ middle) + share * (b @ middle) - turn @ middle)

    empty = renderer(noise=0).image.astype(np.float32)
    clean, kinds = [], []
    for place, (here, there) in enumerate(zip(poses, seconds, strict=True)):
        clean += [shot(here)] * HELD
        kinds += [place] * HELD
        for k in range(CARRIED):  # the shutter is open for a tenth of the way from one frame to the next
            shares = (k + 0.5 + np.array((0.0, 0.1))) / CARRIED
            clean.append(np.mean([shot(between(here, there, share)) for share in shares], axis=0))
            kinds.append("carried")
        if place == PLACES // 2:
            clean += [empty] * EMPTY
            kinds += ["empty"] * EMPTY
    noise = 1.5 * rng.standard_normal(empty.shape, np.float32)
    noisy = [frame + np.roll(noise, rng.integers(99, size=2), (0, 1)) for frame in clean]
    return [np.clip(np.rint(frame), 0, 255).astype(np.uint8) for frame in noisy], kinds


def write_clip(path, frames, coding="MJPG", rate=24):
    """Write frames (H, W, 3) RGB as a video file."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*coding), rate, frames[0].shape[1::-1])
    assert writer.isOpened()
    writer.set(cv2.VIDEOWRITER_PROP_QUALITY, 95)
    for frame in frames:
        writer.write(np.ascontiguousarray(frame[..., ::-1]))
    writer.release()
    return path
