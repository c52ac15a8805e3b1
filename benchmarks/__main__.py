"""Run benchmarks: `python -m benchmarks [NAME ...]`.

The speed comparisons with other libraries run in a few minutes, all of them or those named:

    points       project and unproject a million points; OpenCV, pycolmap
    views        remap images; OpenCV
    calibration  bundle adjustment; cv2.omnidir
    render       the renderer
    birdseye     four 1 MP fisheyes to a view of the ground; OpenCV

The following run one at a time and take options, for example `python -m benchmarks boards --quick`:

    startup      import, and every command in a new process, with and without compiled code. 10 minutes
    features     detection and matching of features on rendered pairs. 10 minutes, with --quick 2
    twoview      poses and points from bearings with outliers; pycolmap, PoseLib. 10 minutes, with --quick 1
    sfm          structure from motion of rendered images; pycolmap. 2 hours, with --quick 5 minutes
    scale        reconstructions of 100 to 10,000 rendered images. 8 hours, --counts 100 300 8 minutes
    bundle       bundle adjustment of 200 poses and 50,000 points; pycolmap. 1 minute
    places       retrieval of rendered images and of a robot's route; pycolmap. 20 minutes, with --quick 2
    compass      headings on a robot's route and of rendered panoramas. 2 minutes, with --quick 1
    rigs         calibration of rendered rigs; OpenCV. 2 minutes
    stereo       distances of rendered stereo pairs. 10 minutes, with --quick 2
    torch        cameras in PyTorch; Kornia and PyEquilib, in an environment with both. 2 minutes
    stitch       stitching of rendered heads; ffmpeg, nona and enblend. 10 minutes, with --quick 3
    video        720p views of a 1080p clip, end to end; ffmpeg. 10 minutes, with --quick 1
    batch        views of many images by workers, with --interrupt killed ones; a plain loop, ffmpeg. 3 minutes
    motion       visual odometry of rendered sequences, and loop closing. 1 hour, with --quick 10 minutes
    boards       board detection; OpenCV. 15 minutes, with --quick 5
    solvers      calibration solvers on corners of real cameras; cv2.omnidir, cv2.fisheye. 5 minutes
    noncentral   errors of central and axial models for non-central cameras. 5 minutes
    noncentrality rates of false and true claims of the non-central test. 30 minutes, --cameras 20 3 minutes
    verdict      agreement of the verdict with the true error. 10 minutes
    model_choice stated uncertainty against the true error when boards are hardly tilted. 1 hour, --seeds 3 6 minutes
    paper_boards sheets that bend differently in each image. 10 minutes, --seeds 2 2 minutes
    summary      the table of the README, from the tables of results in docs/. 1 second
    convergence  share of calibrations that reach the optimum. 1 hour, with --quick 5 minutes

`python -m benchmarks.lines` evaluates the calibration from lines. The environment is described in CONTRIBUTING.md.
"""

import argparse
import importlib
import os
import sys
from collections.abc import Sequence

# Set before numba is imported: all timings are with two threads.
os.environ.setdefault("NUMBA_NUM_THREADS", "2")

import cv2

RACES = ("points", "views", "calibration", "render", "birdseye")
EVALUATIONS = (
    "startup",
    "features",
    "twoview",
    "scale",
    "sfm",
    "bundle",
    "places",
    "compass",
    "rigs",
    "stereo",
    "torch",
    "stitch",
    "video",
    "batch",
    "motion",
    "boards",
    "solvers",
    "noncentral",
    "noncentrality",
    "verdict",
    "model_choice",
    "paper_boards",
    "convergence",
    "summary",
)
NEED_OMNIDIR = ("points", "views", "calibration", "solvers", "rigs")


def main(arguments: Sequence[str]) -> None:
    """Run one evaluation with its options, or the races that are named."""
    if arguments and arguments[0] in EVALUATIONS:
        prepare_opencv(arguments[:1])
        importlib.import_module(f"benchmarks.{arguments[0]}").main(list(arguments[1:]))
        return
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", choices=[*RACES, *EVALUATIONS, []], help="see above")
    names = parser.parse_args(arguments).names
    if alone := [name for name in names if name in EVALUATIONS]:
        parser.error(f"{alone[0]} runs alone: python -m benchmarks {alone[0]}")
    prepare_opencv(names or RACES)
    run_races(names or RACES)


def prepare_opencv(names: Sequence[str]) -> None:
    """Use two threads; exit if a benchmark compares with cv2.omnidir, and OpenCV is not the build that has it."""
    if not hasattr(cv2, "omnidir") and any(name in NEED_OMNIDIR for name in names):
        sys.exit("cv2.omnidir is missing: create the environment of benchmarks/requirements.txt, see CONTRIBUTING.md")
    cv2.setNumThreads(2)


def run_races(names: Sequence[str]) -> None:
    """Run the named speed comparisons and print their table."""
    from benchmarks.race import table

    races = [race for name in names for race in importlib.import_module(f"benchmarks.{name}").run()]
    print(f"OpenCV {cv2.__version__}, two threads, medians of alternating runs\n")
    print(table(races))


if __name__ == "__main__":
    main(sys.argv[1:])
