"""Unroll the image of a mirror camera, and render views in four directions."""

import sys
import tempfile
from pathlib import Path

import omnisight as om
from omnisight.simulation import mirror_setup

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
setup = mirror_setup(960)
camera, image = setup.camera, setup.renderer()().image

# The centre of the image is straight down, so the world's up is at the camera's back. A mirror exchanges left and
# right: a calibrated camera (fx > 0) needs flip=True. This is the true camera, whose fx is negative.
flip = camera.model.to_dict()["fx"] > 0
print(f"{camera.model.name}, xi = {camera.model.to_dict()['xi']}; flip = {flip}")

om.write_image(folder / "mirror.jpg", image)
around = om.remap(image, camera, om.cylinder(1800, elevation=(-45, 18)), om.look(up="back", flip=flip))
om.write_image(folder / "cylinder.jpg", around)
for name, yaw in (("front", 0), ("right", 90), ("back", 180), ("left", -90)):
    rotation = om.look(yaw, -10, up="back", flip=flip)
    om.write_image(folder / f"{name}.jpg", om.remap(image, camera, om.perspective((640, 400), 75), rotation))
planet = om.remap(image, camera, om.planet(720, 215), om.look(pitch=-90, up="back", flip=flip))
om.write_image(folder / "planet.jpg", planet)
print(f"a cylinder, four views and a planet written to {folder}")
