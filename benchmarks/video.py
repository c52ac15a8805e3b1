"""Views of a clip, end to end, beside ffmpeg's v360 with the same encoder and settings on the same two cores.

`python -m benchmarks video` renders a 1080p clip of an equidistant fisheye, makes a 720p perspective view of it with
both programs in turn, and prints the frames per second of both, their ratio, and the PSNR between both videos, which
shows that both compute the same view. The SSIM of each video is that to the uncompressed view of the same program.
ffmpeg with a crop in place of the view only decodes and encodes. The last rows are those of both programs with their
default settings.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

import numpy as np

import omnisight as om
from omnisight.images import Clip
from omnisight.models.equidistant import Equidistant
from omnisight.simulation import Renderer, scene_named

SIZE, VIEW, FOV_DEG = (1920, 1080), (1280, 720), 90.0
# The image circle fills the height; the pixels per radian of ffmpeg are those of its field of view over the side.
CIRCLE_FOV_DEG = 180.0
FRAMES, RUNS, CRF = 300, 5, 20
PRESETS = ("ultrafast", "veryfast", "medium")


def lens() -> om.Camera:
    """Return the equidistant fisheye that ffmpeg models exactly."""
    focal = SIZE[1] / np.radians(CIRCLE_FOV_DEG)
    centre = (SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2
    return om.Camera(Equidistant(focal, focal, *centre), SIZE, theta_max=float(np.radians(CIRCLE_FOV_DEG / 2)))


def render_clip(folder: Path, frames: int) -> Path:
    """Render an image of a town, and encode a clip in which it moves by a pixel per frame, with sound."""
    world = scene_named("street")
    pose = om.Pose(om.look(yaw=20).T, np.array([0.0, -1.7, 0.0]))
    image = Renderer(lens(), pose, world, samples=1)().image
    om.write_image(folder / "fisheye.png", image)
    clip = folder / "fisheye.mp4"
    run(
        f"ffmpeg -y -v error -loop 1 -framerate 30 -i {folder}/fisheye.png -f lavfi -i sine=440 -frames:v {frames}"
        f" -t {frames / 30} -vf scroll=h=0.0005,noise=alls=4:allf=t -c:v libx264 -preset veryfast -crf 18"
        f" -pix_fmt yuv420p -g 60 -c:a aac {clip}"
    )
    return clip


def run(command: str) -> tuple[float, float]:
    """Run a command on two cores and return its duration and its processor time, seconds."""
    cores = sorted(os.sched_getaffinity(0))[:2] if hasattr(os, "sched_setaffinity") else []
    # Installers write the bytecode of all modules.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    start, used = time.perf_counter(), processor_time()
    subprocess.run(
        command.split(),
        check=True,
        stdout=subprocess.DEVNULL,
        env=environment,
        preexec_fn=(lambda: os.sched_setaffinity(0, cores)) if cores else None,
    )
    return time.perf_counter() - start, processor_time() - used


def processor_time() -> float:
    """Return the processor time of finished child processes, seconds."""
    times = os.times()
    return times.children_user + times.children_system


def theirs(clip: Path, output: Path, encoder: str) -> str:
    """Return the command of ffmpeg."""
    vertical = np.degrees(2 * np.arctan(np.tan(np.radians(FOV_DEG / 2)) * VIEW[1] / VIEW[0]))
    horizontal = CIRCLE_FOV_DEG * SIZE[0] / SIZE[1]
    v360 = (
        f"v360=input=fisheye:output=flat:ih_fov={horizontal}:iv_fov={CIRCLE_FOV_DEG}:h_fov={FOV_DEG}:v_fov={vertical}"
        f":w={VIEW[0]}:h={VIEW[1]}:interp=linear"
    )
    return (
        f"ffmpeg -y -v error -threads 2 -filter_threads 2 -i {clip} -vf {v360} -threads 2 -c:a copy {encoder} {output}"
    )


def cropped(clip: Path, output: Path, encoder: str) -> str:
    """Return the command of ffmpeg that encodes a part of the frames."""
    crop = f"-vf crop={VIEW[0]}:{VIEW[1]}"
    return f"ffmpeg -y -v error -threads 2 -filter_threads 2 -i {clip} {crop} -threads 2 -c:a copy {encoder} {output}"


def ours(clip: Path, camera: Path, output: Path, settings: str) -> str:
    """Return the command of omnisight."""
    return (
        f"{sys.executable} -m omnisight view {clip} --camera {camera} --to perspective --fov {FOV_DEG}"
        f" --size {VIEW[0]}x{VIEW[1]} {settings} --quiet -o {output}"
    )


def psnr(a: Path, b: Path, count: int = 10) -> float:
    """Return the PSNR of the luma of the first frames of two clips, dB."""
    pairs = zip(Clip.open(a).frames(), Clip.open(b).frames(), strict=True)
    errors = [np.mean((f.gray.astype(float) - g.gray) ** 2) for (f, g), _ in zip(pairs, range(count), strict=False)]
    return float(10 * np.log10(255**2 / np.mean(errors)))


def ssim(video: Path, uncompressed: Path) -> float:
    """Return the SSIM of the planes of a video, weighted by their pixels, to the same video without compression."""
    # Frames are matched by their number, not by time stamps in the units of both files.
    graph = "[0:v]setpts=N/(30*TB)[a];[1:v]setpts=N/(30*TB)[b];[a][b]ssim"
    command = ["ffmpeg", "-i", str(video), "-i", str(uncompressed), "-lavfi", graph, "-f", "null", "-"]
    report = subprocess.run(command, check=True, capture_output=True, text=True).stderr
    return float(report.rsplit("All:", 1)[1].split()[0])


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks video", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer frames and runs, one preset")
    chosen = parser.parse_args(arguments)
    if not shutil.which("ffmpeg"):
        sys.exit("this comparison needs ffmpeg")
    frames, runs = (90, 1) if chosen.quick else (FRAMES, RUNS)
    presets = PRESETS[:1] if chosen.quick else PRESETS
    print("| encoder | | omnisight | ffmpeg v360 | ratio | ffmpeg, crop | PSNR between both |\n" + "|---" * 7 + "|")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        clip, camera = render_clip(folder, frames), folder / "camera.json"
        om.save(lens(), camera)
        run(ours(clip, camera, folder / "a.mp4", ""))  # compiles the loops
        references = folder / "lossless-a.mp4", folder / "lossless-b.mp4"
        run(ours(clip, camera, references[0], "--preset ultrafast --crf 0"))
        run(theirs(clip, references[1], "-c:v libx264 -preset ultrafast -qp 0"))
        a, b, c = (folder / f"{name}.mp4" for name in "abc")
        for name, settings, encoder in (
            *((f"libx264 {p}", f"--preset {p} --crf {CRF}", f"-c:v libx264 -preset {p} -crf {CRF}") for p in presets),
            ("default settings", "", ""),
        ):
            commands = ours(clip, camera, a, settings), theirs(clip, b, encoder), cropped(clip, c, encoder)
            times = [[run(command) for command in commands] for _ in range(runs)]
            wall, cpu = ([median(row[k][of] for row in times) for k in range(3)] for of in range(2))
            rates = [f"{frames / seconds:.1f}" for seconds in wall]
            used = [f"{1e3 * seconds / frames:.1f}" for seconds in cpu]
            same = f"{wall[1] / wall[0]:.2f} | {rates[2]} | {psnr(a, b):.1f} dB"
            print(f"| {name} | frames per second | {rates[0]} | {rates[1]} | {same} |")
            ratio = f"{cpu[1] / cpu[0]:.2f} | {used[2]}"
            print(f"| | processor time, ms per frame | {used[0]} | {used[1]} | {ratio} | |")
            sizes = [f"{file.stat().st_size / 1e6:.1f}" for file in (a, b, c)]
            print(f"| | size, MB | {sizes[0]} | {sizes[1]} | | {sizes[2]} | |")
            likeness = [f"{ssim(file, reference):.4f}" for file, reference in zip((a, b), references, strict=True)]
            print(f"| | SSIM to the uncompressed view | {likeness[0]} | {likeness[1]} | | | |", flush=True)
        wall, cpu = run(f"ffmpeg -v error -threads 2 -i {clip} -f null -")
        print(f"\nffmpeg only decodes at {frames / wall:.1f} fps, {1e3 * cpu / frames:.1f} ms of processor.")
