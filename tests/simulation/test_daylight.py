"""Time of day, weather and drift of the exposure."""

import numpy as np
import pytest
from render_cameras import GRAY

import omnisight as om
from omnisight.simulation import Renderer, Scene, box, rectangle
from omnisight.simulation.daylight import (
    Daylight,
    clock,
    sky_light,
    stops,
    sun_direction,
    sun_transmission,
    with_daylight,
)
from omnisight.simulation.procedural_textures import outdoors
from omnisight.simulation.scene import Fog
from omnisight.simulation.sensor import exposure_drift
from omnisight.simulation.texture import Texture

SUN = (0.55, -0.75, -0.36)


def yard():
    """Return a gray ground with a box under a gray sky."""
    ground = rectangle((-20, 1.6, 20), (40, 0, 0), (0, 0, -40), GRAY, "ground")
    block = box((-1, -1, 5), (1, 1.6, 6), GRAY, "block")
    return Scene((ground, block), sky=Texture.plain((120, 150, 200)), sun=(SUN, 0.8), ambient=0.5, spacing=0.5)


def light(scene, camera=None):
    return Renderer(camera or om.perspective((32, 32), 90), om.Pose(), scene, samples=1, vignette=0).light()


def elevation(hours, latitude=47.0):
    return np.degrees(np.arcsin(-sun_direction(hours, latitude)[1]))


def test_sun_moves_from_east_over_south_to_west():
    morning, noon, evening = (sun_direction(hours, 47.0) for hours in (8, 12, 16))
    for direction in (morning, noon, evening):
        assert np.linalg.norm(direction) == pytest.approx(1)
    assert morning[0] > 0.3 > abs(noon[0])
    np.testing.assert_allclose(evening, morning * (-1, 1, 1), atol=1e-12)
    assert noon[2] < 0
    # At noon the elevation is 90 degrees - latitude + declination.
    assert elevation(12) == pytest.approx(90 - 47 + 15, abs=1e-9)
    assert sun_direction(12, -40.0)[2] > 0


def test_low_sun_is_dim_and_red():
    high, low = sun_transmission(np.radians(50)), sun_transmission(np.radians(6))
    assert (low < 0.7 * high).all()
    assert low[0] / low[2] > 2 * high[0] / high[2]
    assert not sun_transmission(np.radians(-1)).any()
    assert sky_light(np.radians(-6)) < 1e-3 * sky_light(np.radians(48))


def test_evening_changes_shadows_and_is_darker():
    scene = yard()
    evening = with_daylight(scene, Daylight(18.0))
    assert light(evening).mean() < 0.6 * light(scene).mean()
    assert stops(evening, scene) < -1
    assert evening.sunlight[0] > 1.5 * evening.sunlight[2]
    assert with_daylight(scene, Daylight()) is scene


def test_sunset_has_no_sun():
    evening = with_daylight(yard(), Daylight(19.2))
    assert elevation(19.2) < 0
    assert evening.sun[1] == 0


def test_covered_sky_has_no_shadows():
    scene = with_daylight(yard(), Daylight(weather="overcast"))
    ground = light(scene)[24:, :8, 1]
    assert ground.std() < 0.02 * ground.mean()
    sky = light(Scene((), sky=scene.sky), om.sphere(64))
    # CIE standard overcast sky: the zenith is three times as bright as the horizon.
    assert sky[0].mean() / sky[15].mean() == pytest.approx(3, rel=0.25)


def test_fog_attenuates_light_exponentially_with_the_distance():
    clear = Scene(yard().solids, sun=(SUN, 0.0), spacing=0.5)
    fog = Fog(0.1, (0.5, 0.6, 0.7), 100.0)
    foggy = Scene(yard().solids, sun=(SUN, 0.0), spacing=0.5, fog=fog)
    camera = om.perspective((32, 32), 90)
    depth = Renderer(camera, om.Pose(), clear).truth().depth
    seen = ~np.isnan(depth)
    assert 0.4 < seen.mean() < 1
    kept = np.exp(-0.1 * depth)[..., None]
    expected = light(clear, camera) * kept + np.array(fog.color) * (1 - kept)
    np.testing.assert_allclose(light(foggy, camera)[seen], expected[seen], atol=1e-5)


def test_fog_hides_the_sky():
    fog, overcast = (with_daylight(yard(), Daylight(weather=weather)) for weather in ("fog", "overcast"))
    skies = [light(scene)[:8, :, 1] for scene in (fog, overcast)]
    assert skies[0].std() < 0.3 * skies[1].std()
    horizon = light(fog)[15, 0]
    np.testing.assert_allclose(horizon, fog.fog.color, rtol=0.05)


def test_clouds_depend_on_the_seed():
    first, same, other = (with_daylight(yard(), Daylight(weather="overcast"), seed).sky.image for seed in (0, 0, 1))
    np.testing.assert_array_equal(first, same)
    assert (first != other).mean() > 0.1


def test_skies_are_bright_at_the_zenith_of_a_covered_day():
    sky = outdoors.covered_sky(np.random.default_rng(0), 256)
    # The light on the ground of a hemisphere is the cosine-weighted mean.
    lat = (0.5 - (np.arange(128) + 0.5) / 128) * np.pi
    weight = np.maximum(np.sin(lat), 0) * np.cos(lat)
    assert np.average(sky[..., 0].mean(1), weights=weight) == pytest.approx(1, abs=0.03)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"time": 25.0}, "--time must be from 00:00 to 23:59"),
        ({"time": 23.5}, "--time 23:30: the sun is .* below the horizon.*choose a time from 04:.* to 19:"),
        ({"weather": "hail"}, "--weather must be clear, overcast, rain, fog, got 'hail'"),
    ],
)
def test_invalid_daylight_is_rejected(values, message):
    with pytest.raises(ValueError, match=message):
        Daylight(**values)


def test_rooms_have_no_daylight():
    with pytest.raises(ValueError, match="only to outdoor scenes"):
        with_daylight(Scene(()), Daylight(12.0))


def test_times_are_written_as_a_clock():
    assert [clock(hours) for hours in (0, 17.5, 9 + 5 / 60)] == ["00:00", "17:30", "09:05"]


def test_exposure_drift_is_slow_and_has_the_stated_deviation():
    drift = exposure_drift(np.arange(0, 20_000, 1.0), 0.5, np.random.default_rng(0))
    assert drift.std() == pytest.approx(0.5, rel=0.1)
    assert np.diff(drift).std() < 0.5 * drift.std()
