"""A fixture of all camera types for the renderer tests."""

import pytest
from render_cameras import CAMERAS


@pytest.fixture(params=CAMERAS)
def any_camera(request):
    return CAMERAS[request.param]
