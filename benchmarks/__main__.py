"""Run all benchmarks, or those named: `python -m benchmarks points views calibration render startup`.

`boards`, which takes a quarter of an hour, `solvers`, `noncentral` and `verdict`, which take some minutes, and
`convergence`, which takes an hour, run only where they are named; `python -m benchmarks.boards`, `.convergence` and
`.verdict` have options, and `python -m benchmarks.solvers` takes names of sets.
"""

import os
import sys

os.environ.setdefault("NUMBA_NUM_THREADS", "2")

import cv2

from benchmarks import calibration, points, render, startup, views
from benchmarks.race import table

ALL = {"points": points, "views": views, "calibration": calibration, "render": render, "startup": startup}

if not hasattr(cv2, "omnidir"):
    sys.exit(
        "the peers are missing: pip install '.[bench]', then"
        " pip install --force-reinstall --no-deps opencv-contrib-python-headless"
    )
cv2.setNumThreads(2)
chosen = sys.argv[1:] or list(ALL)
if "boards" in chosen:
    from benchmarks import boards

    boards.main([])
    chosen.remove("boards")
if "solvers" in chosen:
    from benchmarks import solvers

    solvers.main([])
    chosen.remove("solvers")
if "convergence" in chosen:
    from benchmarks import convergence

    convergence.main([])
    chosen.remove("convergence")
if "noncentral" in chosen:
    from benchmarks import noncentral

    noncentral.main()
    chosen.remove("noncentral")
if "verdict" in chosen:
    from benchmarks import verdict

    verdict.main([])
    chosen.remove("verdict")
if not chosen:
    sys.exit()
races = [race for name in chosen for race in ALL[name].run()]
print(f"OpenCV {cv2.__version__}, two threads, medians of runs in turn\n")
print(table(races))
