"""The data set that `omnisight simulate` writes: images and the truth of their pixels, in a folder of its own."""

import io
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.pose import Pose
from omnisight.images import write_bytes, write_image

MARK = "A data set rendered by omnisight simulate."
FOLDERS = ("images", "depth", "normals", "instances")
FILES = (
    "README.txt",
    "settings.json",
    "rig.json",
    "poses.txt",
    "images.txt",
    "depth.txt",
    "camera.json",
    "instances.json",
)
PER_METRE = 1000.0  # steps of a depth image
DEEPEST = 65535
LISTED = "# {kind} of a camera in the {scene}\n# rendered by omnisight simulate\n# timestamp filename\n"  # TUM's lists

README = """{mark}

{settings}

Frames   camera: x right, y down, z forward. World: x right, y down, z forward, metres.
Pixels   (u, v): u right, v down; the middle of the top left pixel is (0, 0).
{layout}
images/      {image}
depth/       {depth}
             From where the ray begins, which is the camera's centre unless the camera is non-central.
normals/     {normals}
instances/   16 bits: which thing a pixel's middle shows, named in instances.json; 0 is the sky or nothing.
poses.txt    TUM format: timestamp tx ty tz qx qy qz qw, world_from_cam, seconds and metres.{shutter}
images.txt, depth.txt
             timestamp and file of each image, as in rgb.txt and depth.txt of the TUM data sets.
camera.json  the camera, to be read by omnisight.
{rig}
Depth, normals and instances are those of the ray through the pixel's middle; there is no noise in them.
"""


SHUTTER = """
             The shutter rolls over {rolling:g} ms: row v of H is read (v - H // 2) / (H - 1) of that after the
             timestamp, the pose is that of row H // 2, and each row's truth is as seen from its own."""


@dataclass(frozen=True)
class Head:
    """A camera of what is moved: its name (of a rig's), its place, and from which angle to which it sees (radians)."""

    name: str
    camera: Any
    rig_from_camera: Pose
    theta: tuple[float, float]


@dataclass(frozen=True)
class Dataset:
    """A folder that is being filled."""

    folder: Path
    heads: Sequence[Head]
    exact: bool
    jpeg: int | None

    @classmethod
    def begin(cls, folder: Path, heads: Sequence[Head], *, exact: bool, jpeg: int | None) -> Self:
        """Make the folder, or clear one that holds an older data set.

        Raises
        ------
        ValueError
            If it is a file or holds something else.
        """
        if folder.exists() and not folder.is_dir():
            raise ValueError(f"{folder}: is a file; name a folder")
        if folder.is_dir() and any(folder.iterdir()):
            readme = folder / "README.txt"
            if not readme.is_file() or not readme.read_text(encoding="utf-8", errors="replace").startswith(MARK):
                raise ValueError(f"{folder}: holds something that is no data set of omnisight; name another folder")
        folder.mkdir(parents=True, exist_ok=True)
        # Written first: what is left of a run that was broken off is still known as ours.
        write_bytes(folder / "README.txt", f"{MARK} Not finished.\n".encode())
        _clear(folder)
        for head in heads:
            for name in FOLDERS:
                (folder / head.name / name).mkdir(parents=True, exist_ok=True)
        return cls(folder, heads, exact, jpeg)

    def write(self, head: Head, number: int, image: NDArray[np.uint8], truth: Any) -> None:
        """Write one image and its truth."""
        from omnisight.simulation.sensor import as_jpeg

        place, name = self.folder / head.name, f"{number:06d}"
        if self.jpeg is None:
            write_image(place / "images" / f"{name}.png", image)
        else:
            write_bytes(place / "images" / f"{name}.jpg", as_jpeg(image, self.jpeg).tobytes())
        write_image(place / "instances" / f"{name}.png", truth.instances.astype(np.uint16))
        if self.exact:
            for kind, values in (("depth", truth.depth), ("normals", truth.normals)):
                file = io.BytesIO()
                np.save(file, values.astype(np.float32), allow_pickle=False)
                write_bytes(place / kind / f"{name}.npy", file.getvalue())
            return
        steps = np.rint(np.nan_to_num(truth.depth) * PER_METRE)
        write_image(place / "depth" / f"{name}.png", np.where(steps > DEEPEST, 0, steps).astype(np.uint16))
        packed = np.rint((np.nan_to_num(truth.normals, nan=-1.0) + 1) / 2 * 65535).astype(np.uint16)
        write_image(place / "normals" / f"{name}.png", packed)

    def finish(self, head: Head, trajectory: Any, scene: str, names: Sequence[str]) -> None:
        """Write what goes with all images of one camera."""
        from omnisight.formats import save
        from omnisight.simulation.trajectory import timestamps, write_trajectory

        place = self.folder / head.name
        save(head.camera, place / "camera.json")
        write_trajectory(place / "poses.txt", trajectory)
        instances = {str(i + 1): name for i, name in enumerate(names)}
        write_bytes(place / "instances.json", (json.dumps(instances, indent=1) + "\n").encode())
        kinds = {"images": "png" if self.jpeg is None else "jpg", "depth": "npy" if self.exact else "png"}
        for kind, suffix in kinds.items():
            lines = [f"{time} {kind}/{i:06d}.{suffix}\n" for i, time in enumerate(timestamps(trajectory.times))]
            write_bytes(place / f"{kind}.txt", (LISTED.format(kind=kind, scene=scene) + "".join(lines)).encode())

    def describe(self, settings: dict[str, Any], poses: Sequence[Pose], times: NDArray[np.float64]) -> None:
        """Write the settings, the rig and the README: the last thing that a whole data set gets."""
        several = bool(self.heads[0].name)
        if several:
            self._save_rig(poses, times)
        write_bytes(self.folder / "settings.json", (json.dumps(settings, indent=1) + "\n").encode())
        exact = (
            "float32, numpy .npy: metres along the bearing, not z; NaN is the sky or nothing.",
            "float32, numpy .npy: unit, in the camera's frame, towards the camera; NaN where there is none.",
        )
        rounded = (
            f"16 bits: distance along the bearing, not z, {PER_METRE:g} steps to a metre; 0 is the sky, nothing,\n"
            f"             or farther than {DEEPEST / PER_METRE:.3f} m.",
            "16 bits a channel: red, green, blue = 65535 (n + 1) / 2 of the unit normal's x, y, z in the\n"
            "             camera's frame, towards the camera; 0 0 0 where there is none.",
        )
        depth, normals = exact if self.exact else rounded
        rolling = settings["rolling_shutter_ms"]
        text = README.format(
            mark=MARK,
            settings="\n".join(f"{name:20} {value}" for name, value in settings.items() if value is not None),
            layout="Each camera has a folder with what follows.\n" if several else "",
            image=f"JPEG of quality {self.jpeg}, sRGB." if self.jpeg else "PNG, sRGB.",
            depth=depth,
            normals=normals,
            shutter=SHUTTER.format(rolling=rolling) * (rolling > 0),
            rig="rig.json     the rig; poses.txt beside it holds world_from_rig.\n" if several else "",
        )
        write_bytes(self.folder / "README.txt", text.encode())

    def _save_rig(self, poses: Sequence[Pose], times: NDArray[np.float64]) -> None:
        from omnisight.formats import save_rig
        from omnisight.rig import Rig
        from omnisight.simulation.trajectory import Trajectory, write_trajectory

        sensors = {head.name: (head.camera, head.rig_from_camera.inverse()) for head in self.heads}
        save_rig(Rig.from_sensors(sensors), self.folder / "rig.json")
        write_trajectory(self.folder / "poses.txt", Trajectory(times, tuple(poses)))


def _clear(folder: Path) -> None:
    """Remove what an older data set left, broken off or whole: what we write, and nothing else."""
    heads = [child for child in folder.iterdir() if all((child / name).is_dir() for name in FOLDERS)]
    for place in (*heads, folder):
        for name in FOLDERS:
            for path in (place / name).glob("[0-9]" * 6 + ".*"):
                if path.suffix in (".png", ".jpg", ".npy"):
                    path.unlink()
            _remove_empty(place / name)
        for name in FILES[1:]:
            (place / name).unlink(missing_ok=True)
    for head in heads:
        _remove_empty(head)


def _remove_empty(folder: Path) -> None:
    if folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()
