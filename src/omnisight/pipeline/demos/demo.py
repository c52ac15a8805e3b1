"""The demonstration: render, calibrate and unroll a fisheye and a mirror camera."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import omnisight as om
from omnisight.camera import Camera
from omnisight.pipeline.calibration.calibrate import calibrate
from omnisight.pipeline.calibration.calibrate_options import CalibrateOptions
from omnisight.pipeline.calibration.calibration import Calibration
from omnisight.progress import Progress, no_progress
from omnisight.simulation import CameraSetup, fisheye_setup, mirror_setup

View = tuple[Camera, NDArray[np.float64]]

IMAGE_COUNT = 12
SETUPS = {"fisheye": fisheye_setup, "mirror": mirror_setup}


@dataclass(frozen=True)
class DemoResult:
    """What the demonstration of one camera wrote.

    Attributes
    ----------
    name
        fisheye or mirror.
    folder
        Where the files are.
    detected
        Number of images in which the board was detected, of `IMAGE_COUNT`.
    calibration
        The calibration result.
    mean_error_deg, max_error_deg
        Angle between the calibrated and the true bearing of the same pixel.
    views
        Names of the views.
    """

    name: str
    folder: Path
    detected: int
    calibration: Calibration
    mean_error_deg: float
    max_error_deg: float
    views: tuple[str, ...]


def demo(output: Path, *, progress: Progress = no_progress) -> list[DemoResult]:
    """Render images of a board by a fisheye and a mirror camera, calibrate them, and write views.

    The true camera is known, so the error of the calibration is exact.

    Parameters
    ----------
    output
        Folder for images, cameras and views; it is created.
    progress
        Called with a stage, the steps done and the total.
    """
    results: list[DemoResult] = []
    for name, setup in SETUPS.items():
        folder = output / name
        (folder / "images").mkdir(parents=True, exist_ok=True)
        camera = setup()
        room, paths = _render(name, camera, folder, progress)
        calibration = calibrate(
            paths,
            CalibrateOptions(pattern="8x5", square="40mm"),
            progress=lambda stage, done, total, n=name: progress(f"{n}: {stage}", done, total),
        )
        calibrated = calibration.camera
        assert isinstance(calibrated, Camera)  # no non-central model was requested
        om.save(calibrated, folder / "camera.json")
        views = _mirror_views() if name == "mirror" else _fisheye_views()
        view_names = _write_views(views, room, calibrated, folder)
        mean, largest = bearing_error_deg(camera.camera, calibrated)
        results.append(DemoResult(name, folder, len(calibration.observations), calibration, mean, largest, view_names))
    return results


def _render(name: str, setup: CameraSetup, folder: Path, progress: Progress) -> tuple[NDArray[np.uint8], list[Path]]:
    """Write the true camera, an image of the empty room and images with the board; return room and board images."""
    progress(f"{name}: render", 0, IMAGE_COUNT)
    renderer = setup.renderer()
    room = renderer().image
    om.write_image(folder / "room.jpg", room)
    provenance = {"tool": "omnisight demo: the true camera"}
    om.save(dataclasses.replace(setup.camera, theta_max=setup.theta[1], provenance=provenance), folder / "truth.json")
    paths: list[Path] = []
    for i, board in enumerate(setup.boards(IMAGE_COUNT)):
        paths.append(folder / "images" / f"{i + 1:02d}.jpg")
        om.write_image(paths[-1], renderer([board], np.random.default_rng(i)).image)
        progress(f"{name}: render", i + 1, IMAGE_COUNT)
    return room, paths


def _fisheye_views() -> dict[str, View]:
    return {
        "perspective": (om.perspective((1280, 800), 100), om.look()),
        "panini": (om.panini((1280, 640), 165), om.look()),
        "sphere": (om.sphere(1600), om.look()),
    }


def _mirror_views() -> dict[str, View]:
    return {
        "cylinder": (om.cylinder(1600, (-50, 18)), om.look(up="back", flip=True)),
        "planet": (om.planet(900, 216), om.look(pitch=-90, up="back", flip=True)),
    }


def _write_views(views: Mapping[str, View], room: NDArray[np.uint8], camera: Camera, folder: Path) -> tuple[str, ...]:
    """Write views of the room by the calibrated camera; return the file names."""
    for name, (target, rotation) in views.items():
        image = om.remap(room, camera, target, rotation, interpolation="bicubic")
        om.write_image(folder / f"{name}.jpg", image)
    return tuple(f"{name}.jpg" for name in views)


def bearing_error_deg(truth: Camera, camera: Camera) -> tuple[float, float]:
    """Return the mean and largest angle between the bearings of the same pixels, over the calibrated field of view."""
    bearings, pixels = camera.samples()
    true, valid = truth.unproject(pixels)
    # A mirror camera is calibrated in a mirrored frame: images of planar boards do not determine the handedness.
    true[:, 0] *= np.sign(getattr(truth.model, "fx", 1.0)) * np.sign(getattr(camera.model, "fx", 1.0))
    chords = np.linalg.norm(true - bearings, axis=1)[valid]
    angles = np.degrees(2 * np.arcsin(chords / 2))
    return float(angles.mean()), float(angles.max())
