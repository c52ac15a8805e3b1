"""Run COLMAP's mapper on bearings, in a process of its own: `python -m omnisight.sfm._colmap_process FOLDER`.

The folder holds `problem.npz`, with the arrays of `ColmapProblem`. The process prints the number of registered images
after each registration, and writes `poses.npz`. COLMAP aborts the process on many errors, and writes the reason to
stderr.
"""

import importlib
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Options of COLMAP that differ from its defaults, besides those that fix the cameras: two images are a model.
MIN_MODEL_SIZE = 2
SEED = 0


class ColmapProblem(NamedTuple):
    """Keypoints and matches in COLMAP's terms.

    Attributes
    ----------
    width
        () of equirectangular images, px.
    pixels, offsets
        (K, 2) keypoints of all images, and the first (I + 1,) of each image.
    sensor, frame
        (I,) indices of the sensor and of the frame of each image.
    sensor_from_rig
        (S, 3, 4).
    ends, b_from_a, has_translation
        (E, 2) images, (E, 3, 4) relative poses, and (E,) whether they have a translation, of the edges.
    starts, pairs
        (E + 1,) first match of each edge, and (N, 2) keypoints of the matches.
    is_global
        () whether to use the global mapper.
    threads
        () number of threads.
    """

    width: NDArray[Any]
    pixels: Array
    offsets: Indices
    sensor: Indices
    frame: Indices
    sensor_from_rig: Array
    ends: Indices
    b_from_a: Array
    has_translation: NDArray[np.bool_]
    starts: Indices
    pairs: Indices
    is_global: NDArray[Any]
    threads: NDArray[Any]

    @property
    def is_rig(self) -> bool:
        """Whether several images share a frame."""
        return len(np.unique(self.frame)) < len(self.frame)


def main(folder: Path) -> None:
    """Map the problem of a folder and write the poses."""
    pycolmap = importlib.import_module("pycolmap")
    with np.load(folder / "problem.npz") as arrays:
        problem = ColmapProblem(**{name: arrays[name] for name in ColmapProblem._fields})
    file = folder / "database.db"
    write_database(pycolmap, problem, file)
    mapper = map_globally if problem.is_global else map_incrementally
    models = mapper(pycolmap, file, folder, int(problem.threads))
    poses = [(number, *pose) for number, model in models.items() for pose in read_poses(pycolmap, problem, model)]
    np.savez(
        folder / "poses.npz",
        model=np.array([pose[0] for pose in poses], np.intp),
        frame=np.array([pose[1] for pose in poses], np.intp),
        rig_from_world=np.array([pose[2] for pose in poses], float).reshape(-1, 3, 4),
    )


def write_database(pycolmap: Any, problem: ColmapProblem, file: Path) -> None:
    """Write cameras, rigs, images, frames, keypoints and verified matches; numbers are indices plus one."""
    database = pycolmap.Database.open(file)
    width = int(problem.width)
    for sensor in range(len(problem.sensor_from_rig)):
        size = {"width": width, "height": width // 2, "params": [width, width // 2]}
        camera = pycolmap.Camera(model="EQUIRECTANGULAR", camera_id=sensor + 1, **size)
        database.write_camera(camera, use_camera_id=True)
    for rig in _rigs(pycolmap, problem):
        database.write_rig(rig, use_rig_id=True)
    for image, sensor in enumerate(problem.sensor.tolist()):
        named = pycolmap.Image(name=f"{image:08d}", camera_id=sensor + 1, image_id=image + 1)
        database.write_image(named, use_image_id=True)
        keypoints = problem.pixels[problem.offsets[image] : problem.offsets[image + 1]]
        database.write_keypoints(image + 1, keypoints.astype(np.float32))
    for number in np.unique(problem.frame).tolist():
        images = np.flatnonzero(problem.frame == number).tolist()
        frame = pycolmap.Frame()
        frame.frame_id = number + 1
        frame.rig_id = 1 if problem.is_rig else int(problem.sensor[images[0]]) + 1
        for image in images:
            frame.add_data_id(pycolmap.data_t(_sensor(pycolmap, int(problem.sensor[image])), image + 1))
        database.write_frame(frame, use_frame_id=True)
    _write_edges(pycolmap, problem, database)
    database.close()


def _rigs(pycolmap: Any, problem: ColmapProblem) -> Iterable[Any]:
    """Return one rig of all sensors, whose first is its frame; without common frames, a rig of each sensor."""
    poses = problem.sensor_from_rig
    for reference in range(1 if problem.is_rig else len(poses)):
        rig = pycolmap.Rig()
        rig.rig_id = reference + 1
        rig.add_ref_sensor(_sensor(pycolmap, reference))
        for other in range(1, len(poses) if problem.is_rig else 0):
            pose = _compose(poses[other], _inverse(poses[0]))
            rig.add_sensor(_sensor(pycolmap, other), _rigid(pycolmap, pose))
        yield rig


def _write_edges(pycolmap: Any, problem: ColmapProblem, database: Any) -> None:
    """Write the matches of all edges as verified ones."""
    kinds = pycolmap.TwoViewGeometryConfiguration
    for edge, (a, b) in enumerate(problem.ends.tolist()):
        geometry = pycolmap.TwoViewGeometry()
        geometry.config = kinds.CALIBRATED if problem.has_translation[edge] else kinds.PANORAMIC
        geometry.cam2_from_cam1 = _rigid(pycolmap, problem.b_from_a[edge])
        pairs = problem.pairs[problem.starts[edge] : problem.starts[edge + 1]]
        geometry.inlier_matches = pairs.astype(np.uint32)
        database.write_two_view_geometry(a + 1, b + 1, geometry)


def map_incrementally(pycolmap: Any, database: Path, folder: Path, threads: int) -> Mapping[int, Any]:
    """Return the models of COLMAP's incremental mapper with fixed cameras."""
    options = pycolmap.IncrementalPipelineOptions()
    options.ba_refine_focal_length = options.ba_refine_extra_params = options.ba_refine_sensor_from_rig = False
    options.mapper.abs_pose_refine_focal_length = options.mapper.abs_pose_refine_extra_params = False
    options.min_model_size, options.extract_colors = MIN_MODEL_SIZE, False
    options.random_seed, options.num_threads = SEED, threads
    count = 2  # images of the initial pair

    def registered() -> None:
        nonlocal count
        count += 1
        print(count, flush=True)

    return pycolmap.incremental_mapping(database, folder, folder, options, next_image_callback=registered)


def map_globally(pycolmap: Any, database: Path, folder: Path, threads: int) -> Mapping[int, Any]:
    """Return the models of COLMAP's global mapper with fixed cameras."""
    options = pycolmap.GlobalPipelineOptions()
    options.min_model_size, options.random_seed, options.num_threads = MIN_MODEL_SIZE, SEED, threads
    options.decompose_relative_pose = False  # they are known
    mapper = options.mapper
    mapper.refine_sensor_from_rig = mapper.rotation_averaging.refine_sensor_from_rig = False
    adjustment = mapper.bundle_adjustment
    adjustment.refine_focal_length = adjustment.refine_extra_params = adjustment.refine_sensor_from_rig = False
    mapper.global_positioning.refine_sensor_from_rig = False
    mapper.global_positioning.use_gpu = adjustment.ceres.use_gpu = False
    return pycolmap.global_mapping(database, folder, folder, options)


def read_poses(pycolmap: Any, problem: ColmapProblem, model: Any) -> Iterable[tuple[int, Array]]:
    """Return frames and their rig_from_world (3, 4), in the unit of the rig if its sensors are apart."""
    scale = _scale(pycolmap, problem, model)
    for frame in model.frames.values():
        if not frame.has_pose():
            continue
        reference = 0 if problem.is_rig else frame.rig_id - 1
        pose = np.array(frame.rig_from_world.matrix(), float)
        pose[:, 3] *= scale
        yield frame.frame_id - 1, _compose(_inverse(problem.sensor_from_rig[reference]), pose)


def _scale(pycolmap: Any, problem: ColmapProblem, model: Any) -> float:
    """Return the distance of the sensor that is farthest from the first, over that in the model."""
    if not problem.is_rig or 1 not in model.rigs:
        return 1.0
    first = _inverse(problem.sensor_from_rig[0])
    known = [float(np.linalg.norm(_compose(pose, first)[:, 3])) for pose in problem.sensor_from_rig]
    farthest = int(np.argmax(known))
    if known[farthest] <= 0.0:
        return 1.0
    found = model.rigs[1].sensor_from_rig(_sensor(pycolmap, farthest)).translation
    return known[farthest] / float(np.linalg.norm(found))


def _sensor(pycolmap: Any, index: int) -> Any:
    return pycolmap.sensor_t(pycolmap.SensorType.CAMERA, index + 1)


def _rigid(pycolmap: Any, pose: Array) -> Any:
    return pycolmap.Rigid3d(pycolmap.Rotation3d(pose[:, :3]), pose[:, 3])


def _inverse(pose: Array) -> Array:
    return np.column_stack([pose[:, :3].T, -pose[:, :3].T @ pose[:, 3]])


def _compose(a: Array, b: Array) -> Array:
    return np.column_stack([a[:, :3] @ b[:, :3], a[:, :3] @ b[:, 3] + a[:, 3]])


if __name__ == "__main__":
    main(Path(sys.argv[1]))
