"""omnisight demo."""

import time
from pathlib import Path
from typing import Any

from omnisight.cli._progress import progress

PICTURES = 12


def demo(output: Path = Path("omnisight-demo"), *, quiet: bool = False) -> None:
    """Render, calibrate and unroll a fisheye and a mirror camera: all of omnisight in half a minute, no camera needed.

    The images are rendered, so the true camera is known: the calibration is measured against it.

    Parameters
    ----------
    output
        The folder for images, cameras and panoramas; made if it is not there.
    quiet
        Show no progress.
    """
    begun = time.perf_counter()
    from omnisight.simulation import fisheye_setup, mirror_setup

    for name, setup in (("fisheye", fisheye_setup), ("mirror", mirror_setup)):
        folder = output / name
        (folder / "images").mkdir(parents=True, exist_ok=True)
        with progress(quiet) as report:
            empty, calibration, found, truth = _calibrate(name, setup(), folder, report)
            report(f"{name}: views", 0, 1)
            views = _views(name, calibration.camera, empty, folder)
            report(f"{name}: views", 1, 1)
        mean, largest = _error_deg(truth, calibration.camera)
        print(f"{name}: the board found in {found} of {PICTURES} images; rms {calibration.rms:.3f} px")
        print(f"  {calibration.reason}")
        print(f"  against the true camera: {mean:.3f} degrees off on average, {largest:.3f} at most")
        print(f"  {folder}/: images/, truth.json, camera.json, {', '.join(views)}")
    print(f"done in {time.perf_counter() - begun:.0f} s. Look at {output / 'mirror' / 'cylinder.jpg'}, then try:\n")
    fisheye, mirror = output / "fisheye", output / "mirror"
    print(f"  omnisight calibrate {fisheye}/images --pattern 8x5 --square 40mm -o camera.json")
    print(f"  omnisight view {fisheye}/room.jpg --camera {fisheye}/camera.json --yaw 45 -o right.jpg")
    camera = f"--camera {mirror}/camera.json --up back --flip"
    print(f"  omnisight view {mirror}/room.jpg {camera} --to cylinder -o around.jpg")


def _calibrate(name: str, setup: Any, folder: Path, report: Any) -> tuple[Any, Any, int, Any]:
    """Render the images and calibrate from them; give the empty room, the calibration, boards found and the truth."""
    import dataclasses

    import numpy as np

    import omnisight as om
    from omnisight.simulation import DEMO_BOARD

    report(f"{name}: render", 0, PICTURES)
    renderer = setup.renderer()
    empty = renderer().image
    om.write_image(folder / "room.jpg", empty)
    provenance = {"tool": "omnisight demo: the true camera"}
    truth = dataclasses.replace(setup.camera, theta_max=setup.theta[1], provenance=provenance)
    om.save(truth, folder / "truth.json")
    paths: list[Path] = []
    for i, board in enumerate(setup.boards(PICTURES)):
        paths.append(folder / "images" / f"{i + 1:02d}.jpg")
        om.write_image(paths[-1], renderer([board], np.random.default_rng(i)).image)
        report(f"{name}: render", i + 1, PICTURES)
    search = om.detect_boards(paths, DEMO_BOARD, progress=lambda done, total: report(f"{name}: find boards", done, total))
    stage = f"{name}: calibrate, "
    result = om.calibrate_pictures(search, progress=lambda what, done, total: report(stage + what, done, total))
    calibration = result.calibration
    om.save(calibration.camera, folder / "camera.json")
    return empty, calibration, len(result.search.found), truth


def _views(name: str, camera: Any, picture: Any, folder: Path) -> list[str]:
    """Write what the calibrated camera makes of the room; give the names."""
    import omnisight as om

    if name == "mirror":
        targets = {
            "cylinder": (om.cylinder(1600, (-50, 18)), om.look(up="back", flip=True)),
            "planet": (om.planet(900, 216), om.look(pitch=-90, up="back", flip=True)),
        }
    else:
        targets = {
            "perspective": (om.perspective(100, (1280, 800)), om.look()),
            "panini": (om.panini(165, (1280, 640)), om.look()),
            "sphere": (om.sphere(1600), om.look()),
        }
    for view, (target, rotation) in targets.items():
        om.write_image(folder / f"{view}.jpg", om.remap(picture, camera, target, rotation, interpolation="bicubic"))
    return [f"{view}.jpg" for view in targets]


def _error_deg(truth: Any, camera: Any) -> tuple[float, float]:
    """Give mean and largest angle (degrees) between the bearings of equal pixels, over the calibrated cone."""
    import numpy as np

    bearings, pixels = camera.samples()
    true, valid = truth.unproject(pixels)
    # A mirror's image is calibrated in a mirrored frame, for images of plane boards cannot tell.
    true[:, 0] *= np.sign(truth.model.fx) * np.sign(getattr(camera.model, "fx", 1.0))
    chords = np.linalg.norm(true - bearings, axis=1)[valid]
    angles = np.degrees(2 * np.arcsin(chords / 2))
    return float(angles.mean()), float(angles.max())
