"""The methods of `benchmarks.sfm`, each run in a process of its own: `python -m benchmarks.sfm_methods METHOD FOLDER`.

Prints `pose FRAME` with rig_from_world (12 numbers) for each frame of the largest model, then `result` with the number
of points, the rms of the residuals, px, the time, seconds, and the peak memory, MB.
"""

import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import omnisight as om
from benchmarks.own_process import peak_memory
from omnisight.reconstructions._perspective_views import PerspectiveView, perspective_views

Array = NDArray[np.float64]

# Images up to which all pairs are matched; in larger sets each with the following ones.
MAX_EXHAUSTIVE, WINDOW = 60, 10


@dataclass(frozen=True)
class Model:
    """Poses rig_from_world (3, 4) of frames, the number of points, and the rms of the residuals, px."""

    poses: Mapping[int, Array]
    points: int = 0
    rms_px: float = float("nan")


def image_files(folder: Path) -> list[Path]:
    """Return the images of a set: of its camera, or of the cameras of its rig."""
    return sorted(folder.glob("**/images/*.jpg"))


def frame_of(path: str | Path) -> int:
    """Return the number of the frame that an image is of."""
    return int(Path(path).stem)


def frame_count(folder: Path) -> int:
    """Return the number of frames."""
    return len({frame_of(path) for path in image_files(folder)})


def omnisight(folder: Path, engine: str) -> Model:
    """Reconstruct with omnisight: all pairs, or those of a sequence, as the peers."""
    pairs = "auto" if frame_count(folder) <= MAX_EXHAUSTIVE else "sequential"
    options = om.ReconstructOptions(pairs=pairs, window=WINDOW, engine=engine)
    rig = folder / "rig.json"
    source = {"rig": rig} if rig.exists() else {"camera": folder / "camera.json"}
    result = om.reconstruct(image_files(folder), **source, options=options)
    if not result:
        return Model({})
    model = result.models[0]
    frames = {int(frame): frame_of(name) for frame, name in zip(model.frame, model.names, strict=True)}
    poses = {frames[k]: pose.matrix for k, pose in enumerate(model.rig_from_world) if k in frames}
    return Model(poses, len(model.points), model.rms_px)


def colmap_sphere(folder: Path, mapper: str) -> Model:
    """Reconstruct 360 images with pycolmap's own SIFT and the camera EQUIRECTANGULAR."""
    import pycolmap

    with tempfile.TemporaryDirectory() as work:
        database, images = Path(work) / "database.db", folder / "images"
        reader = pycolmap.ImageReaderOptions()
        reader.camera_model = "EQUIRECTANGULAR"
        pycolmap.extract_features(database, images, camera_mode=pycolmap.CameraMode.SINGLE, reader_options=reader)
        match(pycolmap, database, frame_count(folder), pycolmap.FeatureMatchingOptions())
        return best_model(pycolmap, map_images(pycolmap, database, images, Path(work), mapper))


def colmap_views(folder: Path, mapper: str) -> Model:
    """Reconstruct the cube faces that cameras cover with pycolmap, as the pinhole cameras of a rig."""
    import pycolmap

    with tempfile.TemporaryDirectory() as work:
        root, database = Path(work), Path(work) / "database.db"
        rig = write_views(pycolmap, folder, root)
        reader = pycolmap.ImageReaderOptions()
        reader.camera_model, reader.mask_path = "PINHOLE", root / "masks"
        images, mode = root / "images", pycolmap.CameraMode.PER_FOLDER
        pycolmap.extract_features(database, images, camera_mode=mode, reader_options=reader)
        with pycolmap.Database.open(database) as opened:
            pycolmap.apply_rig_config([rig], opened)
        options = pycolmap.FeatureMatchingOptions()
        options.skip_image_pairs_in_same_frame = options.rig_verification = True
        match(pycolmap, database, frame_count(folder), options)
        model = best_model(pycolmap, map_images(pycolmap, database, images, root, mapper))
        first = views_of(folder)[0]
        rig_from_first = (first[1].pose @ first[2]).inverse()
        poses = {k: (rig_from_first @ om.Pose.of_matrix(pose)).matrix for k, pose in model.poses.items()}
        return Model(poses, model.points, model.rms_px)


def views_of(folder: Path) -> list[tuple[str, PerspectiveView, om.Pose]]:
    """Return name, view and sensor_from_rig of all cube faces of all cameras; the name is empty for a single camera."""
    if not (folder / "rig.json").exists():
        return [("", view, om.Pose()) for view in perspective_views(om.load(folder / "camera.json"), None, None)]
    rig = om.load_rig(folder / "rig.json")
    cameras = zip(rig.names, rig.cameras, rig.sensor_from_rig, strict=True)
    return [(name, view, pose) for name, camera, pose in cameras for view in perspective_views(camera, None, None)]


def write_views(pycolmap: Any, folder: Path, root: Path) -> Any:
    """Write views and their masks, and return the configuration of their rig."""
    cameras = []
    for k, (name, view, sensor_from_rig) in enumerate(views_of(folder)):
        own = f"{name}_{view.name}"
        for path in image_files(folder / name if name else folder):
            image = view.remapper(om.read_image(path))
            for kind, content in (("images", image), ("masks", np.where(view.mask, 255, 0).astype(np.uint8))):
                target = root / kind / own / (f"{path.stem}.png" + (".png" if kind == "masks" else ""))
                target.parent.mkdir(parents=True, exist_ok=True)
                om.write_image(target, content)
        face, pose = view.remapper.target, view.pose @ sensor_from_rig
        if k == 0:
            rig_from_first = pose.inverse()
        camera = pycolmap.RigConfigCamera()
        camera.image_prefix, camera.ref_sensor = f"{own}/", k == 0
        model = face.model
        params = [model.fx, model.fy, model.cx + 0.5, model.cy + 0.5]
        camera.camera = pycolmap.Camera(model="PINHOLE", width=face.size[0], height=face.size[1], params=params)
        if k:
            relative = pose @ rig_from_first
            camera.cam_from_rig = pycolmap.Rigid3d(pycolmap.Rotation3d(relative.rotation), relative.translation)
        cameras.append(camera)
    config = pycolmap.RigConfig()
    config.cameras = cameras
    return config


def match(pycolmap: Any, database: Path, frames: int, options: Any) -> None:
    """Match all pairs of images, or those of a sequence."""
    if frames <= MAX_EXHAUSTIVE:
        pycolmap.match_exhaustive(database, options)
        return
    pairing = pycolmap.SequentialPairingOptions()
    pairing.overlap, pairing.quadratic_overlap = WINDOW, False
    pycolmap.match_sequential(database, options, pairing)


def map_images(pycolmap: Any, database: Path, images: Path, work: Path, mapper: str) -> Mapping[int, Any]:
    """Return the models of a mapper of pycolmap with fixed intrinsics and fixed poses of the sensors."""
    if mapper == "global":
        options = pycolmap.GlobalPipelineOptions()
        adjustment = options.mapper.bundle_adjustment
        adjustment.refine_focal_length = adjustment.refine_extra_params = adjustment.refine_sensor_from_rig = False
        options.mapper.refine_sensor_from_rig = False
        return pycolmap.global_mapping(database, images, work, options)
    options = pycolmap.IncrementalPipelineOptions()
    options.ba_refine_focal_length = options.ba_refine_extra_params = options.ba_refine_sensor_from_rig = False
    return pycolmap.incremental_mapping(database, images, work, options)


def best_model(pycolmap: Any, models: Mapping[int, Any]) -> Model:
    """Return the model of pycolmap with most frames."""
    best = max(models.values(), key=lambda model: model.num_reg_frames(), default=None)
    if best is None:
        return Model({})
    poses, squares = dict[int, Array](), list[Array]()
    for image in best.images.values():
        if not image.has_pose:
            continue
        poses[frame_of(image.name)] = image.frame.rig_from_world.matrix()
        seen = [p for p in image.points2D if p.has_point3D()]
        if not seen:
            continue
        camera = best.cameras[image.camera_id]
        points = np.array([best.points3D[p.point3D_id].xyz for p in seen])
        matrix = image.cam_from_world().matrix()
        residuals = camera.img_from_cam(points @ matrix[:, :3].T + matrix[:, 3]) - [p.xy for p in seen]
        if camera.model_name == "EQUIRECTANGULAR":
            residuals[:, 0] -= camera.width * np.round(residuals[:, 0] / camera.width)
        squares.append((residuals**2).sum(axis=1))
    rms = float(np.sqrt(np.concatenate(squares).mean())) if squares else float("nan")
    return Model(poses, best.num_points3D(), rms)


METHODS: dict[str, Callable[[Path], Model]] = {
    "omnisight": lambda folder: omnisight(folder, "omnisight"),
    "omnisight, engine colmap": lambda folder: omnisight(folder, "colmap"),
    "pycolmap 360, incremental": lambda folder: colmap_sphere(folder, "incremental"),
    "pycolmap 360, global": lambda folder: colmap_sphere(folder, "global"),
    "pycolmap cube rig, incremental": lambda folder: colmap_views(folder, "incremental"),
    "pycolmap cube rig, global": lambda folder: colmap_views(folder, "global"),
}


def printed_poses(rows: Sequence[Sequence[str]]) -> dict[int, Array]:
    """Return the poses rig_from_world (3, 4) of frames that `main` printed, of the words of its lines."""
    return {int(row[1]): np.array(row[2:], float).reshape(3, 4) for row in rows if row[0] == "pose"}


def main(method: str, folder: str) -> None:
    """Run a method and print its model, time and memory."""
    start = time.perf_counter()
    model = METHODS[method](Path(folder))
    seconds = time.perf_counter() - start
    for frame, pose in model.poses.items():
        print("pose", frame, *np.asarray(pose).ravel())
    print("result", model.points, model.rms_px, seconds, peak_memory())


if __name__ == "__main__":
    main(*sys.argv[1:])
