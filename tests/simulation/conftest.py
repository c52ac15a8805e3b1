"""Cameras of all kinds, for the tests of the renderer."""

import pytest
from sights import SIGHTS


@pytest.fixture(params=SIGHTS)
def sight(request):
    return SIGHTS[request.param]
