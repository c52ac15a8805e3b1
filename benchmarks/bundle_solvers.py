"""The solvers of `benchmarks.bundle`, each run in a process of its own.

`python -m benchmarks.bundle_solvers SOLVER PROBLEM RESULT` prints `megabytes PEAK` and, for omnisight,
lines `cost SECONDS COST`; Ceres prints its own table.
"""

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.own_process import peak_memory

Array = NDArray[np.float64]

WIDTH = 2000
MAX_ITERATIONS, TOLERANCE = 100, 1e-7


def omnisight(problem: Any) -> tuple[Array, Array]:
    """Return poses (F, 3, 4) and points (P, 3) of omnisight's bundle adjustment."""
    from omnisight.optim.loss import StudentT
    from omnisight.sfm.bundle_adjustment import Bundle, adjust_bundle
    from omnisight.sfm.structure import RayObservations, Structure

    rotations, count = problem["rotations"], len(problem["frame"])
    poses = np.concatenate([rotations, -rotations @ problem["centers"][:, :, None]], axis=2)
    indices = problem["frame"], np.zeros(count, np.intp), problem["point"]
    rays = RayObservations(*indices, np.zeros((count, 3)), *bearings_and_axes(problem["pixels"]))
    bundle = Bundle(rays, StudentT(), Structure(poses, np.eye(3, 4)[None], problem["points"]))
    start = time.perf_counter()
    print("cost", 0.0, bundle.cost(bundle.start))

    def watch(_: int, cost: float) -> None:
        print("cost", time.perf_counter() - start, cost)

    found = adjust_bundle(bundle, tolerance=TOLERANCE, watch=watch).state
    return found.rig_from_world, found.points


def bearings_and_axes(pixels: Array) -> tuple[Array, Array]:
    """Return the bearings (M, 3) of pixels, and the derivatives (M, 2, 3) of the pixels by them."""
    longitude, latitude = (2 * np.pi * (pixels / WIDTH - (0.5, 0.25))).T
    (sx, cx), (sy, cy) = ((np.sin(angle), np.cos(angle)) for angle in (longitude, latitude))
    axes = np.empty((len(pixels), 2, 3))
    axes[:, 0] = np.column_stack([cx, 0 * cx, -sx]) / cy[:, None]
    axes[:, 1] = np.column_stack([-sx * sy, cy, -cx * sy])
    axes *= WIDTH / (2 * np.pi)
    return np.column_stack([sx * cy, sy, cx * cy]), axes


def pycolmap(problem: Any) -> tuple[Array, Array]:
    """Return poses (F, 3, 4) and points (P, 3) of pycolmap's bundle adjustment."""
    import pycolmap

    model = pycolmap.Reconstruction()
    size = {"width": WIDTH, "height": WIDTH // 2, "params": [WIDTH, WIDTH // 2]}
    model.add_camera_with_trivial_rig(pycolmap.Camera(model="EQUIRECTANGULAR", camera_id=1, **size))
    frame, config = problem["frame"], pycolmap.BundleAdjustmentConfig()
    place = np.empty(len(frame), int)
    for k, (rotation, center) in enumerate(zip(problem["rotations"], problem["centers"], strict=True)):
        seen = np.flatnonzero(frame == k)
        place[seen] = np.arange(len(seen))
        image = pycolmap.Image(str(k), problem["pixels"][seen], 1, k + 1)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pycolmap.Rotation3d(rotation), -rotation @ center))
        config.add_image(k + 1)
    starts = np.searchsorted(problem["point"], np.arange(len(problem["points"]) + 1))
    for point, first, last in zip(problem["points"], starts, starts[1:], strict=False):
        elements = [pycolmap.TrackElement(frame[i] + 1, place[i]) for i in range(first, last)]
        model.add_point3D(point, pycolmap.Track(elements), np.zeros(3, np.uint8))
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_focal_length = options.refine_extra_params = options.refine_sensor_from_rig = False
    options.print_summary = False
    solver = options.ceres.solver_options
    solver.max_num_iterations, solver.function_tolerance = MAX_ITERATIONS, TOLERANCE
    solver.gradient_tolerance = solver.parameter_tolerance = 0.0
    solver.minimizer_progress_to_stdout = True
    solver.logging_type = pycolmap._core.pyceres.LoggingType.PER_MINIMIZER_ITERATION
    pycolmap.create_default_bundle_adjuster(options, config, model).solve()
    poses = [model.images[k + 1].cam_from_world().matrix() for k in range(len(problem["rotations"]))]
    return np.array(poses), np.array([model.points3D[k].xyz for k in sorted(model.points3D)])


def main(solver: str, problem: str, result: str) -> None:
    """Solve a problem and print costs, times and memory."""
    poses, points = {"omnisight": omnisight, "pycolmap": pycolmap}[solver](np.load(problem))
    print("megabytes", peak_memory())
    np.savez(Path(result), poses=poses, points=points)


if __name__ == "__main__":
    main(*sys.argv[1:])
