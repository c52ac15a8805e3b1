"""The code of visual odometry is loaded before it is needed."""

import subprocess
import sys

SCRIPT = """
import sys
from pathlib import Path
import omnisight as om
from omnisight.compiled import FolderCache
from omnisight.visual_odometry.warm_up import warm_up

def loaded():
    modules = [module for name, module in sys.modules.items() if name.startswith("omnisight.")]
    loops = {id(x): x for module in modules for x in vars(module).values()}.values()
    return {(x.__module__, x.__name__, s) for x in loops if isinstance(getattr(x, "_cache", None), FolderCache)
            for s in x.signatures}

folder = Path(sys.argv[1])
images = [om.read_image(path) for path in sorted((folder / "images").iterdir())[:12]]
camera = om.load(folder / "camera.json")
assert len(images) == 12 and not loaded()
warm_up(camera)
before = loaded()
tracking = om.Odometry(camera)
for k, image in enumerate([*images, images[-1][::-1, ::-1]]):
    tracking.add(image, k / 10)
tracking.finish()
assert tracking.keyframes > 3 and tracking.lost, tracking
assert len(before) > 20 and loaded() == before, (before, loaded() - before)
"""


def test_odometry_after_the_warm_up_loads_no_more_code(fisheye):
    subprocess.run([sys.executable, "-c", SCRIPT, fisheye.folder], check=True)
