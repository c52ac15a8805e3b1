"""The demonstration of structure from motion: reconstruct a rendered walk, and compare it with the truth."""

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from omnisight.pipeline.reconstruction.reconstruct import reconstruct
from omnisight.pipeline.reconstruction.reconstruct_options import ReconstructOptions
from omnisight.pipeline.reconstruction.reconstruction_result import ReconstructionResult
from omnisight.pipeline.simulation.simulate import SimulateOptions, simulate
from omnisight.progress import Progress, no_progress
from omnisight.sfm.georeference import least_squares_similarity
from omnisight.simulation.trajectory import read_trajectory
from omnisight.views import sphere

# Images of the walk, and their width.
IMAGE_COUNT, IMAGE_WIDTH_PX = 40, 1024
# Following images that each is matched with.
WINDOW = 5


@dataclass(frozen=True, eq=False)
class DemoMap:
    """A reconstruction of rendered images.

    Attributes
    ----------
    images
        Folder of the images.
    result
        The reconstruction.
    median_error_m, path_m
        Median error of the positions after a similarity transform, and length of the path.
    """

    images: Path
    result: ReconstructionResult
    median_error_m: float
    path_m: float


def demo_map(output: Path, *, progress: Progress = no_progress) -> DemoMap:
    """Render 360 images along a closed path in a room, and reconstruct poses and points.

    Parameters
    ----------
    output
        Folder for the images with their ground truth; it is created.
    progress
        Called with a stage, the steps done and the total.
    """
    rendered = output / "rendered"
    shutil.rmtree(rendered, ignore_errors=True)
    camera = sphere(IMAGE_WIDTH_PX)
    simulate(SimulateOptions("room", camera, rendered, frames=IMAGE_COUNT, rays=1, jpeg=90), progress=progress)
    options = ReconstructOptions(pairs="sequential", window=WINDOW)
    result = reconstruct(rendered / "images", camera, options=options, progress=progress)
    truth = np.array([pose.translation for pose in read_trajectory(rendered / "poses.txt").poses])
    path = float(np.linalg.norm(np.diff(truth, axis=0), axis=1).sum())
    model = result.models[0]
    found = np.array([model.world_from_cam(image).translation for image in range(len(model))])
    true = truth[[int(Path(name).stem) for name in model.names]]
    errors = np.linalg.norm(least_squares_similarity(found, true) @ found - true, axis=1)
    return DemoMap(rendered / "images", result, float(np.median(errors)), path)
