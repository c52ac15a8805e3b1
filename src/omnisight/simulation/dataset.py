"""The data set that `omnisight simulate` writes: a folder of images with ground truth for every pixel."""

import io
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from omnisight.display import Displayed
from omnisight.formats import save
from omnisight.geometry.pose import Pose
from omnisight.images import write_bytes, write_image
from omnisight.rig import Rig, Sensor
from omnisight.simulation import motion_sensor_files
from omnisight.simulation.rendered import GroundTruth
from omnisight.simulation.scene import Scene
from omnisight.simulation.sensor import encode_jpeg
from omnisight.simulation.texture import LINEAR
from omnisight.simulation.trajectory import Trajectory, format_timestamps, write_trajectory

# First words of the README: they identify a folder that may be overwritten.
MARKER = "A data set rendered by omnisight simulate."
FOLDERS = ("images", "depth", "normals", "instances")
# Only with moving objects.
MASK_FOLDER = "masks"
FILES = (
    *("settings.json", "rig.json", "poses.txt", "images.txt", "depth.txt"),
    *("camera.json", "instances.json", "vignette.png", "vignette.npy", "pcalib.txt"),
    *("exposure.csv", *motion_sensor_files.FILES),
)
# Folders of these files, besides those of the images.
FILE_FOLDERS = (motion_sensor_files.FOLDER,)
MAX_UINT8, MAX_UINT16 = 255, 65535
# Depth resolutions of 16-bit images: fine for rooms, and KITTI's, which reaches 256 m.
FINE_DEPTH_STEPS, COARSE_DEPTH_STEPS = 1000.0, 256.0
EXPOSURE_DESCRIPTION = "exposure.csv exposure of each image in stops, instead of the one above.\n"
MASK_DESCRIPTION = "masks/       8 bits: 255 where the image shows what is static, 0 on moving objects.\n"
# Header of the TUM file lists.
LIST_HEADER = "# {kind} of a camera in the {scene}\n# rendered by omnisight simulate\n# timestamp filename\n"

README = """{marker}

{settings}

Frames   camera: x right, y down, z forward. World: x right, y down, z forward, metres.
Pixels   (u, v): u right, v down; the centre of the top left pixel is (0, 0).
{layout}
images/      {image}
depth/       {depth}
             Measured from the start of the ray: the camera centre, except for non-central cameras.
normals/     {normals}
instances/   16 bits: the object at the pixel's centre; instances.json has its name. 0 is sky or nothing.
poses.txt    TUM format: timestamp tx ty tz qx qy qz qw, world_from_cam, seconds and metres.{shutter}
images.txt, depth.txt
             timestamp and file of each image, as rgb.txt and depth.txt of the TUM data sets.
camera.json  the camera, readable by omnisight.
vignette     {vignette}
pcalib.txt   the light of each of the 256 levels, times 255, as in TUM's visual odometry benchmark: the inverse of the
             sRGB response. An image without noise, blur and JPEG is response(2^exposure vignette light).
{rig}{more}
Depth, normals and instances are sampled at the pixel's centre and have no noise.
"""

VIGNETTE = ": the share of the light of the image's brightest part, without exposure."
ROLLING_SHUTTER = """
             Rolling shutter of {rolling:g} ms: row v of H is read (v - H // 2) / (H - 1) of that after the timestamp.
             The pose is that of row H // 2. The ground truth of each row is as seen from its own pose."""

EXACT_FORMATS = (
    "float32, NumPy .npy: metres along the bearing, not z; NaN is sky or nothing.",
    "float32, NumPy .npy: unit vectors in the camera frame, towards the camera; NaN is sky or nothing.",
)
ROUNDED_FORMATS = (
    "16 bits: distance along the bearing, not z, {steps:g} steps per metre; 0 is sky, nothing,\n"
    "             or more than {farthest:.3f} m.",
    "16 bits per channel: red, green, blue = 65535 (n + 1) / 2 of the unit normal's x, y, z in the\n"
    "             camera frame, towards the camera; 0 0 0 is sky or nothing.",
)


@dataclass(frozen=True)
class MountedCamera(Displayed):
    """A camera of the simulated body.

    Attributes
    ----------
    name
        Name in the rig; empty for a single camera.
    camera
        Central or not.
    rig_from_camera
        Its pose on the body.
    theta
        Range of angles from the axis (radians) that its images show.
    """

    name: str
    camera: Sensor
    rig_from_camera: Pose
    theta: tuple[float, float]


@dataclass(frozen=True)
class Dataset:
    """A data set folder that is being written."""

    folder: Path
    cameras: Sequence[MountedCamera]
    exact: bool
    jpeg: int | None
    depth_steps: float

    @classmethod
    def create(
        cls, folder: Path, cameras: Sequence[MountedCamera], *, exact: bool, jpeg: int | None, depth_steps: float
    ) -> Self:
        """Create the folder, or clear one that holds an older data set.

        Raises
        ------
        ValueError
            If it is a file or has other content.
        """
        if folder.exists() and not folder.is_dir():
            raise ValueError(f"{folder}: is a file; choose a folder")
        if folder.is_dir() and any(folder.iterdir()):
            readme = folder / "README.txt"
            if not readme.is_file() or not readme.read_text(encoding="utf-8", errors="replace").startswith(MARKER):
                raise ValueError(
                    f"{folder}: contains files that are not of a simulated data set; choose another folder"
                )
        folder.mkdir(parents=True, exist_ok=True)
        # Written first: an interrupted run can then be overwritten.
        write_bytes(folder / "README.txt", f"{MARKER} Not finished.\n".encode())
        _clear(folder)
        for camera in cameras:
            for name in FOLDERS:
                (folder / camera.name / name).mkdir(parents=True, exist_ok=True)
        return cls(folder, cameras, exact, jpeg, depth_steps)

    def write_frame(self, camera: MountedCamera, number: int, image: NDArray[np.uint8], truth: GroundTruth) -> None:
        """Write one image and its ground truth."""
        folder, name = self.folder / camera.name, f"{number:06d}"
        if self.jpeg is None:
            write_image(folder / "images" / f"{name}.png", image)
        else:
            write_bytes(folder / "images" / f"{name}.jpg", encode_jpeg(image, self.jpeg).tobytes())
        write_image(folder / "instances" / f"{name}.png", truth.instances.astype(np.uint16))
        if self.exact:
            for kind, values in (("depth", truth.depth), ("normals", truth.normals)):
                _write_array(folder / kind / f"{name}.npy", values)
            return
        steps = np.rint(np.nan_to_num(truth.depth) * self.depth_steps)
        write_image(folder / "depth" / f"{name}.png", np.where(steps > MAX_UINT16, 0, steps).astype(np.uint16))
        packed = np.rint((np.nan_to_num(truth.normals, nan=-1.0) + 1) / 2 * MAX_UINT16).astype(np.uint16)
        write_image(folder / "normals" / f"{name}.png", packed)

    def write_mask(self, camera: MountedCamera, number: int, moving: NDArray[np.bool_]) -> None:
        """Write the mask of one image: 0 where an object moves (H, W), else 255."""
        folder = self.folder / camera.name / MASK_FOLDER
        folder.mkdir(exist_ok=True)
        write_image(folder / f"{number:06d}.png", np.where(moving, 0, MAX_UINT8).astype(np.uint8))

    def write_photometry(self, camera: MountedCamera, vignetting: NDArray[np.float32]) -> None:
        """Write the photometric ground truth of one camera: vignetting (H, W) and response."""
        folder = self.folder / camera.name
        if self.exact:
            _write_array(folder / "vignette.npy", vignetting)
        else:
            write_image(folder / "vignette.png", np.rint(vignetting * MAX_UINT16).astype(np.uint16))
        inverse_response = " ".join(f"{255 * light:.6f}" for light in LINEAR)
        write_bytes(folder / "pcalib.txt", f"{inverse_response}\n".encode())

    def write_exposures(
        self, camera: MountedCamera, times: NDArray[np.float64], exposures: NDArray[np.float64]
    ) -> None:
        """Write the exposures (N,), stops, of the images of a camera at times (N,)."""
        rows = zip(format_timestamps(times), exposures.tolist(), strict=True)
        lines = [f"{time},images/{i:06d}{self.image_suffix},{value:.6f}\n" for i, (time, value) in enumerate(rows)]
        text = "#timestamp [s],filename,exposure [stops]\n" + "".join(lines)
        write_bytes(self.folder / camera.name / "exposure.csv", text.encode())

    @property
    def image_suffix(self) -> str:
        """File ending of the images."""
        return ".png" if self.jpeg is None else ".jpg"

    def write_camera(self, camera: MountedCamera, trajectory: Trajectory, scene: str, names: Sequence[str]) -> None:
        """Write the camera file, poses, instance names and file lists of one camera."""
        folder = self.folder / camera.name
        save(camera.camera, folder / "camera.json")
        write_trajectory(folder / "poses.txt", trajectory)
        instances = {str(i + 1): name for i, name in enumerate(names)}
        write_bytes(folder / "instances.json", (json.dumps(instances, indent=1) + "\n").encode())
        kinds = {"images": self.image_suffix, "depth": ".npy" if self.exact else ".png"}
        for kind, suffix in kinds.items():
            times = format_timestamps(trajectory.times)
            lines = [f"{time} {kind}/{i:06d}{suffix}\n" for i, time in enumerate(times)]
            write_bytes(folder / f"{kind}.txt", (LIST_HEADER.format(kind=kind, scene=scene) + "".join(lines)).encode())

    def finish(self, settings: dict[str, Any], trajectory: Trajectory, descriptions: Sequence[str] = ()) -> None:
        """Write the rig, the settings and, last, the README that marks the data set as complete.

        Parameters
        ----------
        settings
            What settings.json holds.
        trajectory
            world_from_rig.
        descriptions
            Sections of the README on optional files.
        """
        is_rig = bool(self.cameras[0].name)
        if is_rig:
            sensors = {c.name: (c.camera, c.rig_from_camera.inverse()) for c in self.cameras}
            save(Rig.from_sensors(sensors), self.folder / "rig.json")
            write_trajectory(self.folder / "poses.txt", trajectory)
        write_bytes(self.folder / "settings.json", (json.dumps(settings, indent=1) + "\n").encode())
        depth, normals = EXACT_FORMATS if self.exact else ROUNDED_FORMATS
        rolling = settings["rolling_shutter_ms"]
        text = README.format(
            marker=MARKER,
            settings="\n".join(f"{name:20} {value}" for name, value in settings.items() if value is not None),
            layout="Each camera has a folder with the following files.\n" if is_rig else "",
            image=f"JPEG of quality {self.jpeg}, sRGB." if self.jpeg else "PNG, sRGB.",
            depth=depth.format(steps=self.depth_steps, farthest=MAX_UINT16 / self.depth_steps),
            normals=normals,
            vignette=".npy, float32" if self.exact else ".png, 16 bits, 65535 for 1" + VIGNETTE,
            shutter=ROLLING_SHUTTER.format(rolling=rolling) * (rolling > 0),
            rig="rig.json     the rig; poses.txt beside it holds world_from_rig.\n" if is_rig else "",
            more="".join(descriptions),
        )
        write_bytes(self.folder / "README.txt", text.encode())


def depth_steps_per_metre(scene: Scene) -> float:
    """Return the finest depth resolution at which 16 bits reach everything from the free space of a scene."""
    bounds = np.array([solid.bounds() for solid in scene.solids]).reshape(-1, 2, 3)
    low, high = np.array(scene.free, float)
    farthest = np.maximum(high - bounds[:, 0], bounds[:, 1] - low)
    distance = float(np.linalg.norm(farthest, axis=1).max(initial=0.0))
    return FINE_DEPTH_STEPS if distance * FINE_DEPTH_STEPS <= MAX_UINT16 else COARSE_DEPTH_STEPS


def _write_array(path: Path, values: NDArray[Any]) -> None:
    file = io.BytesIO()
    np.save(file, values.astype(np.float32), allow_pickle=False)
    write_bytes(path, file.getvalue())


def _clear(folder: Path) -> None:
    """Remove the files of an older data set, and nothing else."""
    cameras = [child for child in folder.iterdir() if all((child / name).is_dir() for name in FOLDERS)]
    for parent in (*cameras, folder):
        for name in (*FOLDERS, MASK_FOLDER):
            for path in (parent / name).glob("[0-9]" * 6 + ".*"):
                if path.suffix in (".png", ".jpg", ".npy"):
                    path.unlink()
            _remove_if_empty(parent / name)
        for name in FILES:
            (parent / name).unlink(missing_ok=True)
        for name in FILE_FOLDERS:
            _remove_if_empty(parent / name)
    for camera in cameras:
        _remove_if_empty(camera)


def _remove_if_empty(folder: Path) -> None:
    if folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()
