"""Stitching of rendered heads against the true panorama, beside ffmpeg's v360 and Hugin's nona and enblend.

`python -m benchmarks stitch` prints the table of docs/guide/stitch.md. Two fisheyes of 200 degrees back to back are
rendered with different exposures and vignetting; the truth is a sphere rendered at the origin of the rig.
"""

import argparse
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

import omnisight as om
from benchmarks.features_pairs import free_region
from omnisight.geometry.rotation import look
from omnisight.images.video_writer import VideoWriter
from omnisight.models.equidistant import Equidistant
from omnisight.simulation import Renderer, scene_named
from omnisight.simulation.example_rigs import back_to_back

Bytes = NDArray[np.uint8]

WIDTH, LENS = 1920, 960
SCENES = ("room", "street")
# Exposure of the second camera relative to the first, stops.
EXPOSURE = 0.3
FIELD_DEG = 200.0
FRAMES = 40


def equidistant_head(size: int, apart: float) -> om.Rig:
    """Return a head whose lenses ffmpeg and nona can model exactly."""
    rig = back_to_back(size, apart)
    focal, centre = 0.49 * size / np.radians(FIELD_DEG / 2), (size - 1) / 2
    lens = om.Camera(
        Equidistant(focal, focal, centre, centre), (size, size), theta_max=float(np.radians(FIELD_DEG / 2))
    )
    return om.Rig((lens, lens), rig.sensor_from_rig, rig.names)


def render(scene: str, apart: float) -> tuple[om.Rig, Bytes, Bytes, Bytes]:
    """Return the rig, both images and the true sphere."""
    rig = equidistant_head(LENS, apart)
    world = scene_named(scene)
    low, high = free_region(scene)
    pose = om.Pose(look(yaw=20).T, low + 0.5 * (high - low))
    images: list[Bytes] = []
    for k, camera in enumerate(rig.cameras):
        at = pose @ rig.sensor_from_rig[k].inverse()
        renderer = Renderer(camera, at, world, theta=(0.0, np.radians(FIELD_DEG / 2)), vignette=0.35)
        images.append(renderer(exposure=EXPOSURE * k, rng=np.random.default_rng(k)).image)
    truth = Renderer(om.sphere(WIDTH), pose, world)(noise=0.0, blur=0.0).image
    return rig, images[0], images[1], truth


def score(image: Bytes, truth: Bytes) -> tuple[float, float]:
    """Return PSNR and SSIM in the band of 20 degrees around the seam, after the best common gain of each channel."""
    columns = np.abs((np.arange(WIDTH) + 0.5) / WIDTH * 360 - 180)
    rows = np.abs((np.arange(WIDTH // 2) + 0.5) / WIDTH * 360 - 90) < 60
    band = np.ix_(rows, np.abs(columns - 90) < 10)
    a, b = image[band].astype(np.float64), truth[band].astype(np.float64)
    a = a * ((a * b).sum((0, 1)) / np.maximum((a * a).sum((0, 1)), 1e-9))
    psnr = 10 * np.log10(255**2 / np.mean((a - b) ** 2))
    return float(psnr), ssim(a.mean(-1), b.mean(-1))


def ssim(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Return the mean structural similarity (Wang et al. 2004) with a Gaussian window of 1.5 px."""
    blur = lambda x: cv2.GaussianBlur(x, (0, 0), 1.5)  # noqa: E731
    mean_a, mean_b = blur(a), blur(b)
    variance_a, variance_b = blur(a * a) - mean_a**2, blur(b * b) - mean_b**2
    covariance = blur(a * b) - mean_a * mean_b
    c1, c2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    value = (2 * mean_a * mean_b + c1) * (2 * covariance + c2)
    return float(np.mean(value / ((mean_a**2 + mean_b**2 + c1) * (variance_a + variance_b + c2))))


def residual_disparity(image: Bytes, truth: Bytes) -> float:
    """Return the median displacement against the truth in the same band, degrees, where there is texture."""
    gray = [cv2.cvtColor(x, cv2.COLOR_RGB2GRAY) for x in (truth, image)]
    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM).calc(
        gray[0], gray[1], np.zeros((*gray[0].shape, 2), np.float32)
    )
    columns = np.abs((np.arange(WIDTH) + 0.5) / WIDTH * 360 - 180)
    rows = np.abs((np.arange(WIDTH // 2) + 0.5) / WIDTH * 360 - 90) < 60
    band = np.ix_(rows, np.abs(columns - 90) < 10)
    texture = np.abs(cv2.Sobel(gray[0], cv2.CV_32F, 1, 0)) + np.abs(cv2.Sobel(gray[0], cv2.CV_32F, 0, 1))
    moved = np.hypot(flow[..., 0], flow[..., 1])[band][texture[band] > 80]
    return float(np.median(moved) / WIDTH * 360) if moved.size else float("nan")


def ffmpeg(front: Bytes, back: Bytes, folder: Path) -> Bytes:
    """Stitch by ffmpeg's v360, which assumes equidistant lenses side by side, and blends nothing."""
    om.write_image(folder / "dual.png", np.hstack([back, front]))  # the right half is in the centre
    field = FIELD_DEG * LENS / (0.98 * LENS)  # of the side of the square, whose image circle has a radius of 0.49
    run(
        f"ffmpeg -y -v error -i {folder}/dual.png -vf"
        f" v360=dfisheye:e:ih_fov={field}:iv_fov={field}:w={WIDTH}:h={WIDTH // 2} {folder}/ffmpeg.png"
    )
    return om.read_image(folder / "ffmpeg.png")


def hugin(rig: om.Rig, front: Bytes, back: Bytes, folder: Path) -> Bytes:
    """Stitch by nona and enblend with the exact exposure, as Hugin would after optimization."""
    lines = [f'p f2 w{WIDTH} h{WIDTH // 2} v360 n"TIFF_m c:NONE"', "m i0"]
    for k, image in enumerate((front, back)):
        om.write_image(folder / f"{k}.png", image)
        field = FIELD_DEG * LENS / (0.98 * LENS)
        crop = f"S{round(0.01 * LENS)},{round(0.99 * LENS)},{round(0.01 * LENS)},{round(0.99 * LENS)}"
        lines.append(f'i w{LENS} h{LENS} f2 v{field} r0 p0 y{180 * k} Eev{-EXPOSURE * k} {crop} n"{folder}/{k}.png"')
    (folder / "head.pto").write_text("\n".join(lines) + "\n")
    run(f"nona -m TIFF_m -o {folder}/layer {folder}/head.pto")
    run(f"enblend -w -f{WIDTH}x{WIDTH // 2} -o {folder}/hugin.tif {folder}/layer0000.tif {folder}/layer0001.tif")
    return om.read_image(folder / "hugin.tif")[..., :3]


def run(command: str) -> None:
    subprocess.run(command.split(), check=True, capture_output=True)


def rows_of(scene: str, apart: float) -> list[str]:
    """Return the rows of the table of a scene and baseline."""
    rig, front, back, truth = render(scene, apart)
    found: list[tuple[str, Bytes]] = []
    options = om.StitchOptions(width=WIDTH)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        found.append(("omnisight, rig", om.stitch([front, back], rig, options).image))
        try:
            found.append(("omnisight, without calibration", om.stitch([front, back], None, options).image))
        except ValueError as error:
            print(f"without calibration: {error}")
        if shutil.which("ffmpeg"):
            found.append(("ffmpeg v360", ffmpeg(front, back, folder)))
        if shutil.which("nona") and shutil.which("enblend"):
            found.append(("nona and enblend", hugin(rig, front, back, folder)))
    lines: list[str] = []
    for method, image in found:
        psnr, similarity = score(image, truth)
        disparity = residual_disparity(image, truth)
        lines.append(f"| {scene}, {100 * apart:g} cm | {method} | {psnr:.2f} | {similarity:.4f} | {disparity:.3f} |")
    return lines


def speed(size: int, width: int) -> None:
    """Print the frames a second of a clip of two lenses of `size` px to a sphere, beside ffmpeg."""
    rig = equidistant_head(size, 0.024)
    front, back = (
        Renderer(camera, pose.inverse(), samples=1)().image
        for camera, pose in zip(rig.cameras, rig.sensor_from_rig, strict=True)
    )
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        options = om.VideoOptions(preset="ultrafast")
        with VideoWriter(folder / "d.mp4", (2 * size, size), 30.0, options) as clip:
            for k in range(FRAMES):
                clip.write(np.hstack([front, back]), k / 30)
        stitching = om.StitchOptions(width=width)
        om.stitch(folder / "d.mp4", rig, stitching)  # compiles the loops
        result = om.stitch(folder / "d.mp4", rig, stitching, output=folder / "o.mp4", video=options)
        print(f"omnisight: {1 / result.frame_seconds:.1f} frames a second, maps and seam {result.seconds:.1f} s in all")
        if shutil.which("ffmpeg"):
            start = time.perf_counter()
            run(
                f"ffmpeg -y -v error -threads 2 -filter_threads 2 -i {folder}/d.mp4 -vf"
                f" v360=dfisheye:e:ih_fov=204:iv_fov=204:w={width}:h={width // 2} -c:v libx264 -preset ultrafast"
                f" -crf 20 {folder}/f.mp4"
            )
            print(f"ffmpeg: {FRAMES / (time.perf_counter() - start):.1f} frames a second")


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks stitch", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="one baseline")
    parser.add_argument(
        "--speed",
        action="store_true",
        help="only frames a second of clips of 3840x1920, with the same encoder settings",
    )
    chosen = parser.parse_args(arguments)
    if chosen.speed:
        speed(1920, 3840)
        return
    print("| scene, baseline | method | PSNR dB | SSIM | displacement ° |\n" + "|---" * 5 + "|")
    for scene in SCENES:
        for apart in (0.04,) if chosen.quick else (0.02, 0.04, 0.06):
            print("\n".join(rows_of(scene, apart)), flush=True)
