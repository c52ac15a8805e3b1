"""One reconstruction of `benchmarks.scale`, in its own process.

`python -m benchmarks.scale_reconstruction COUNT WIDTH PER_VISIT` prints `stage SECONDS NAME` for each stage, then
`result` with the numbers of registered images, correct images, points and observations, the errors of positions and
rotations, the time, seconds, and the peak memory, MB.
"""

import os
import sys
import time
from pathlib import Path

import numpy as np

import omnisight as om
from benchmarks.own_process import peak_memory
from benchmarks.scale_images import render, true_poses
from benchmarks.sfm_score import pose_errors


class StageTimes:
    """The time that each stage has taken so far."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Add the time since the last call to a stage."""
        now = time.perf_counter()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self._last
        self._last = now


def main(count: int, width: int, per_visit: int) -> None:
    """Reconstruct the first images of a width, px, and print what it took; see `benchmarks.scale_images.render`."""
    files, times = render(count, width, per_visit), StageTimes()
    start = time.perf_counter()
    times("start", 0, 0)
    result = om.reconstruct(files, om.sphere(width), progress=times)
    seconds = time.perf_counter() - start
    for stage, value in times.seconds.items():
        print("stage", value, stage)
    if not result:
        raise RuntimeError(result.reason)
    model, folder = result.models[0], Path(os.path.commonpath([path.parent for path in files]))
    truth = true_poses([folder / name for name in model.names])
    steps = np.diff([each.translation for each in truth], axis=0)
    errors = pose_errors(
        [model.world_from_cam(i) for i in range(len(model))], truth, float(np.linalg.norm(steps, axis=1).sum())
    )
    numbers = len(model), errors.correct, len(model.points), len(model.observations)
    print("result", *numbers, errors.position, errors.rotation_deg, seconds, peak_memory())


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
