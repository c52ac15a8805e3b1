"""Views of many images: workers against a plain loop and against FFmpeg's v360, on the same files."""

import argparse
import os
import pickle
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import omnisight as om
from omnisight.models import model_class
from omnisight.pipeline.batch.batch_options import BatchOptions


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--images", type=int, default=2000)
    parser.add_argument("--size", type=int, default=640, help="width of the square fisheye images, px")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        measure(Path(folder), options)


def measure(folder: Path, options: argparse.Namespace) -> None:
    """Print the images per second of each method."""
    camera, source = make_images(folder / "images", options.images, options.size)
    view = om.ViewOptions(size=(options.size, options.size * 3 // 4), interpolation="bilinear")
    rates = {
        "plain loop, one thread": plain(camera, source, folder / "plain", view),
        "batch, one worker": batch(camera, source, folder / "one", view, BatchOptions(workers=1)),
        f"batch, {options.workers} workers": batch(
            camera, source, folder / "several", view, BatchOptions(workers=options.workers)
        ),
    }
    if shutil.which("ffmpeg"):
        rates["ffmpeg v360"] = ffmpeg(source, folder / "ffmpeg", options.size)
    reference = rates["plain loop, one thread"]
    print(f"| {options.images} images of {options.size} px | images/s | ratio |\n|---|---|---|")
    for name, rate in rates.items():
        print(f"| {name} | {rate:.1f} | {rate / reference:.2f} |")


def make_images(folder: Path, count: int, size: int) -> tuple[om.Camera, Path]:
    """Write copies of a few noisy fisheye images, as JPEG."""
    focal = size / np.radians(185.0)
    camera = om.Camera(model_class("equidistant")(focal, focal, (size - 1) / 2, (size - 1) / 2), (size, size))
    rng = np.random.default_rng(0)
    folder.mkdir()
    smooth = om.sphere(256)
    for i in range(8):
        texture = rng.integers(0, 256, (smooth.height, smooth.width, 3)).astype(np.uint8)
        om.write_image(folder / f"{i:06}.jpg", om.remap(texture, smooth, camera))
    for i in range(8, count):
        shutil.copyfile(folder / f"{i % 8:06}.jpg", folder / f"{i:06}.jpg")
    return camera, folder


def plain(camera: om.Camera, source: Path, output: Path, options: om.ViewOptions) -> float:
    """Return the rate of `om.view` in one thread."""
    code = (
        "import sys, time, pickle, omnisight as om\n"
        "from pathlib import Path\n"
        "camera, options = pickle.load(open(sys.argv[3], 'rb'))\n"
        "first = sorted(Path(sys.argv[1]).iterdir())[:1]\n"
        "om.view(first, camera, Path(sys.argv[2] + '-first.png'), options)\n"
        "start = time.perf_counter()\n"
        "om.view([sys.argv[1]], camera, Path(sys.argv[2]), options)\n"
        "print(time.perf_counter() - start)\n"
    )
    arguments = output.with_suffix(".pickle")
    arguments.write_bytes(pickle.dumps((camera, options)))
    environment = {**os.environ, "OMNISIGHT_THREADS": "1", "OPENCV_FOR_THREADS_NUM": "1"}
    command = [sys.executable, "-c", code, str(source), str(output), str(arguments)]
    seconds = float(subprocess.run(command, check=True, env=environment, capture_output=True, text=True).stdout)
    return len(list(source.iterdir())) / seconds


def batch(camera: om.Camera, source: Path, output: Path, options: om.ViewOptions, workers: BatchOptions) -> float:
    """Return the rate of `om.view_batch`, with the start of its workers."""
    start = time.perf_counter()
    om.view_batch(str(source), camera, str(output), options, workers)
    return len(list(source.iterdir())) / (time.perf_counter() - start)


def ffmpeg(source: Path, output: Path, size: int) -> float:
    """Return the rate of the filter v360 of an equidistant fisheye to a perspective view, with PNG files."""
    output.mkdir()
    view = f"v360=fisheye:flat:ih_fov=185:iv_fov=185:h_fov=90:v_fov=73.7:w={size}:h={size * 3 // 4}"
    command = ["ffmpeg", "-loglevel", "error", "-i", str(source / "%06d.jpg"), "-vf", view, str(output / "%06d.png")]
    start = time.perf_counter()
    subprocess.run(command, check=True)
    return len(list(source.iterdir())) / (time.perf_counter() - start)


if __name__ == "__main__":
    main()
