"""Render perspective, panoramic and fisheye views of a fisheye image."""

import sys
import tempfile
from pathlib import Path

import omnisight as om
from omnisight.simulation import fisheye_setup

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
setup = fisheye_setup()
camera, image = setup.camera, setup.renderer()().image  # or om.load("camera.json"), om.read_image("image.jpg")
om.write_image(folder / "image.jpg", image)

# The camera of each view, and its direction in degrees (yaw right, pitch up).
views = {
    "ahead": (om.perspective((960, 640), 100), om.look()),
    "window": (om.perspective((960, 640), 70), om.look(yaw=50, pitch=5)),
    "panini": (om.panini((1200, 600), 165), om.look()),
    "cylinder": (om.cylinder(1200, elevation=(-45, 45), azimuth=(-90, 90)), om.look()),
    "sphere": (om.sphere(1600), om.look()),
    "ideal_fisheye": (om.fisheye(720, 180, "equisolid"), om.look()),
}
for name, (target, target_from_camera) in views.items():
    view = om.remap(image, camera, target, target_from_camera, interpolation="bicubic")
    om.write_image(folder / f"{name}.jpg", view)
    print(f"{name}: {target.width}x{target.height}, {target.model.name}")
print(f"written to {folder}")
