"""Turns one fisheye picture into views: each is a camera, and the same call makes them all."""

import sys
import tempfile
from pathlib import Path

import omnisight as om
from omnisight.simulate import fisheye_setup

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
setup = fisheye_setup()
camera, picture = setup.camera, setup.renderer()().image  # or om.load("camera.json"), om.read_image("picture.jpg")
om.write_image(folder / "picture.jpg", picture)

# The camera looks down by 8 degrees; views that look up by 8 from its axis are level.
views = {
    "ahead": (om.perspective(100, (960, 640)), om.look(pitch=8)),
    "window": (om.perspective(70, (960, 640)), om.look(yaw=50, pitch=8)),
    "panini": (om.panini(165, (1200, 600)), om.look(pitch=8)),
    "cylinder": (om.cylinder(1200, elevation=(-45, 45), azimuth=(-90, 90)), om.look(pitch=8)),
    "sphere": (om.sphere(1600), om.look(pitch=8)),
    "ideal_fisheye": (om.fisheye(720, 180, "equisolid"), om.look(pitch=8)),
}
for name, (target, target_from_camera) in views.items():
    view = om.remap(picture, camera, target, target_from_camera, interpolation="bicubic")
    om.write_image(folder / f"{name}.jpg", view)
    print(f"{name}: {target.width}x{target.height}, {target.model.name}")
print(f"written to {folder}")
