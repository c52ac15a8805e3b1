"""Bird's-eye view of four 1 MP fisheyes, against the usual chain of OpenCV: undistort, warp, and add with masks."""

import cv2
import numpy as np

import omnisight as om
from benchmarks.race import Race, race
from omnisight.pipeline.birdseye.birdseye import prepare_birdseye
from omnisight.simulation.example_rigs import surround_car
from omnisight.views.ground_view import GroundView

# 1184 x 888 px is 1.05 MP.
WIDTH_PX = 1184
# A frame of a camera with 30 frames a second, seconds.
FRAME_S = 1 / 30


def run() -> list[Race]:
    rig = surround_car(WIDTH_PX)
    rng = np.random.default_rng(0)
    images = [
        cv2.resize(rng.integers(0, 255, (56, 74, 3), np.uint8), camera.size, interpolation=cv2.INTER_CUBIC)
        for camera in rig.cameras
    ]
    renderer = prepare_birdseye(images, rig, om.BirdseyeOptions(margin="3.5m"))
    plain = prepare_birdseye(images, rig, om.BirdseyeOptions(margin="3.5m", gain=False))
    theirs = opencv_chain(rig, renderer.view, renderer.remapper.weights)
    width, height = renderer.view.size
    work = f"4 x {WIDTH_PX}x{rig.cameras[0].height} to {width}x{height}"
    equalized = race(f"{work}, equalized", lambda: renderer(images), lambda: theirs(images), "cv2.fisheye chain", 1)
    blended = race(f"{work}, blended", lambda: plain(images), lambda: theirs(images), "cv2.fisheye chain", 1)
    per_second = f"{1 / equalized.ours:.0f} frames per second"
    limit = Race(f"{work}, equalized", equalized.ours, FRAME_S, "30 frames a second", 1, per_second)
    return [equalized, blended, limit]


def opencv_chain(rig: om.Rig, view: GroundView, weights: np.ndarray) -> object:
    """Return a function from images to the view: remap to perspective, warp by a homography, add with the same weights.

    All maps are precomputed in fixed point, as surround-view programs do.
    """
    stages = []
    for camera, pose, weight in zip(rig.cameras, rig.sensor_from_rig, weights, strict=True):
        m = camera.model
        k, d = np.array([[m.fx, 0, m.cx], [0, m.fy, m.cy], [0, 0, 1.0]]), np.array([m.k1, m.k2, m.k3, m.k4])
        new_k = np.diag([0.4, 0.4, 1.0]) @ k
        new_k[:2, 2] = k[:2, 2]
        maps = cv2.fisheye.initUndistortRectifyMap(k, d, np.eye(3), new_k, camera.size, cv2.CV_16SC2)
        # Ground (right, forward, 1) of a view pixel, then its pixel in the perspective image.
        step, (left, _, _, front) = view.meters_per_pixel, view.extent
        ground = np.array([[step, 0, left + step / 2], [0, -step, front - step / 2], [0, 0, 1]])
        plane = np.column_stack([pose.rotation[:, 0], pose.rotation[:, 2], pose.translation])
        stages.append((maps, new_k @ plane @ ground, np.repeat(weight[..., None], 3, axis=2)))

    def render(images: list[np.ndarray]) -> np.ndarray:
        total = np.zeros((*view.size[::-1], 3), np.float32)
        for image, (maps, homography, weight) in zip(images, stages, strict=True):
            flat = cv2.remap(image, *maps, cv2.INTER_LINEAR)
            flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
            top = cv2.warpPerspective(flat, homography, view.size, flags=flags)
            cv2.accumulateProduct(top.astype(np.float32), weight, total)
        return total.astype(np.uint8)

    return render
