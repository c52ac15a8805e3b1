"""Outdoor light: the sun at a time of day, and the weather."""

from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.simulation.procedural_textures import outdoors
from omnisight.simulation.scene import Fog, Scene
from omnisight.simulation.texture import ENCODED, LINEAR, Texture
from omnisight.simulation.world import SKYLIGHT, SUNLIGHT

Array = NDArray[np.float64]
Weather = Literal["clear", "overcast", "rain", "fog"]

# About 1 May and 12 August.
SUN_DECLINATION_RAD = float(np.radians(15))
# Optical depth of a clear atmosphere at the zenith for red, green and blue: molecules and some haze.
OPTICAL_DEPTH = np.array((0.11, 0.17, 0.31))
# Light of the clear sky on a horizontal surface by the sun's elevation (degrees), klx; approximate.
SKY_ELEVATION_DEG = np.array((-6.0, -3.0, 0.0, 5.0, 10.0, 20.0, 48.0, 90.0))
SKY_KLX = np.array((0.0034, 0.05, 0.6, 2.5, 4.5, 7.5, 13.0, 17.0))
# Civil twilight: below it, streets are dark without lamps.
MIN_ELEVATION_RAD = float(np.radians(-6))
# Contrast that is just visible at the visibility (Koschmieder).
EXTINCTION_AT_VISIBILITY = 3.912


class _Sky(NamedTuple):
    """Weather: light of the sky relative to that of the clear scene, visibility and height of its layer (metres)."""

    light: float
    visibility: float
    height: float


COVERED = {
    "overcast": _Sky(1.2, np.inf, 0.0),
    "rain": _Sky(0.7, 1500.0, 600.0),
    "fog": _Sky(1.1, 90.0, 150.0),
}
# Colour of covered skies.
GRAY = np.array((0.97, 1.0, 1.04))


@dataclass(frozen=True)
class Daylight:
    """Time of day and weather.

    Attributes
    ----------
    time
        Local solar time, hours; None for the sun of the scene.
    weather
        clear, overcast, rain or fog.
    latitude
        Degrees; north is +z of the world.
    """

    time: float | None = None
    weather: Weather = "clear"
    latitude: float = 47.3769

    def __post_init__(self) -> None:
        """Check the time, and that the sun is not far below the horizon."""
        if self.weather not in ("clear", *COVERED):
            raise ValueError(f"--weather must be clear, {', '.join(COVERED)}, got {self.weather!r}")
        if self.time is None:
            return
        if not 0 <= self.time < 24:
            raise ValueError(f"--time must be from 00:00 to 23:59, got {self.time:g} hours")
        elevation = float(np.arcsin(-sun_direction(self.time, self.latitude)[1]))
        if elevation < MIN_ELEVATION_RAD:
            hours = np.arange(0, 24, 1 / 6)
            light = [h for h in hours if -sun_direction(h, self.latitude)[1] > np.sin(MIN_ELEVATION_RAD)]
            advice = (
                f"choose a time from {clock(light[0])} to {clock(light[-1])}" if light else "choose another --origin"
            )
            raise ValueError(
                f"--time {clock(self.time)}: the sun is {-np.degrees(elevation):.0f} degrees below the horizon, and the"
                f" streets have no light; {advice}"
            )


def clock(hours: float) -> str:
    """Return a time of day as HH:MM."""
    minutes = round(hours * 60)
    return f"{minutes // 60:02d}:{minutes % 60:02d}"


def sun_direction(hours: float, latitude: float) -> Array:
    """Return the direction (3,) to the sun in the world (x east, y down, z north) at a local solar time.

    Parameters
    ----------
    hours
        0 to 24; the sun is in the south at 12 on the northern hemisphere.
    latitude
        Degrees.
    """
    turn, phi, delta = np.radians(15 * (hours - 12)), np.radians(latitude), SUN_DECLINATION_RAD
    east = -np.cos(delta) * np.sin(turn)
    north = np.cos(phi) * np.sin(delta) - np.sin(phi) * np.cos(delta) * np.cos(turn)
    up = np.sin(phi) * np.sin(delta) + np.cos(phi) * np.cos(delta) * np.cos(turn)
    return np.array((east, -up, north))


def sun_transmission(elevation: float) -> Array:
    """Return the share (3,) of sunlight that passes the atmosphere for red, green and blue; 0 below the horizon."""
    degrees = np.degrees(elevation)
    if degrees <= 0:
        return np.zeros(3)
    # Kasten and Young 1989, equation 3.
    air_mass = 1 / (np.sin(elevation) + 0.50572 * (degrees + 6.07995) ** -1.6364)
    return np.exp(-OPTICAL_DEPTH * air_mass)


def sky_light(elevation: float) -> float:
    """Return the light of the clear sky at an elevation of the sun, klx."""
    return float(np.exp(np.interp(np.degrees(elevation), SKY_ELEVATION_DEG, np.log(SKY_KLX))))


def with_daylight(scene: Scene, daylight: Daylight, seed: int = 0) -> Scene:
    """Return an outdoor scene at a time of day and in a weather.

    Light is relative to the scene as it is, which is clear: the atmosphere dims and reddens a low sun, the light of the
    sky depends on the sun's elevation, and clouds cover the sun. The seed is that of the clouds.

    Raises
    ------
    ValueError
        If the scene has no sky.
    """
    if scene.sky is None:
        raise ValueError("--time and --weather apply only to outdoor scenes: street and town")
    if daylight.time is None and daylight.weather == "clear":
        return scene
    usual = np.array(scene.sun[0]) / np.linalg.norm(scene.sun[0])
    sun = usual if daylight.time is None else sun_direction(daylight.time, daylight.latitude)
    elevation, usual_elevation = (float(np.arcsin(-direction[1])) for direction in (sun, usual))
    level = sky_light(elevation) / sky_light(usual_elevation)
    rng = np.random.default_rng((seed, 2, 1, 1))
    towards = tuple(sun.tolist())
    if daylight.weather == "clear":
        light = np.array(SUNLIGHT) * sun_transmission(elevation) / sun_transmission(usual_elevation)
        image = _tinted(outdoors.sky(rng, towards), sun, level, elevation)
        strength = scene.sun[1] if elevation > 0 else 0.0
        colours = {"sunlight": tuple(light.tolist()), "skylight": tuple(_twilight(elevation).tolist())}
        return replace(
            scene, sun=(towards, strength), sky=Texture(image), ambient=scene.ambient * level, _lights={}, **colours
        )
    covered = COVERED[daylight.weather]
    ambient = scene.ambient * level * covered.light
    fog = Fog(EXTINCTION_AT_VISIBILITY / covered.visibility, tuple((ambient * GRAY).tolist()), covered.height)
    return replace(
        scene,
        sun=(towards, 0.0),
        sky=Texture(ENCODED[np.rint(65535 * np.clip(outdoors.covered_sky(rng) * ambient * GRAY, 0, 1)).astype(int)]),
        ambient=ambient,
        skylight=tuple(GRAY.tolist()),
        fog=fog,
        _lights={},
    )


def stops(scene: Scene, usual: Scene) -> float:
    """Return by how many stops the light on the ground of a scene is above that of another one."""
    return float(np.log2(_ground_light(scene) / _ground_light(usual)))


def _ground_light(scene: Scene) -> float:
    up = -scene.sun[0][1] / float(np.linalg.norm(scene.sun[0]))
    return scene.ambient * (scene.skylight or SKYLIGHT)[1] + scene.sun[1] * scene.sunlight[1] * max(up, 0.0)


def _twilight(elevation: float) -> Array:
    """Return the colour of skylight: bluer when the sun is low."""
    low = np.clip(1 - np.degrees(elevation) / 15, 0, 1)
    return np.array(SKYLIGHT) * (1 - low * np.array((0.08, 0.04, -0.06)))


def _tinted(image: NDArray[np.uint8], sun: Array, level: float, elevation: float) -> NDArray[np.uint8]:
    """Dim a sky by the time of day, and redden it near the horizon and the sun when the sun is low."""
    height, width = image.shape[:2]
    lon = ((np.arange(width) + 0.5) / width * 2 - 1) * np.pi
    lat = (0.5 - (np.arange(height)[:, None] + 0.5) / height) * np.pi
    cosine = np.cos(lat) * (np.sin(lon) * sun[0] + np.cos(lon) * sun[2]) - np.sin(lat) * sun[1]
    off = np.arccos(np.clip(cosine, -1, 1))
    low = float(np.clip(1 - np.degrees(elevation) / 20, 0, 1))
    share = low * np.exp(-np.abs(lat) / 0.3) * (0.3 + 0.7 * np.exp(-off / 0.7))
    warm = np.array((1.5, 0.82, 0.42))
    light = LINEAR[image] * (1 + share[..., None] * (warm - 1))
    # The sky near a low sun remains bright when the ground is dark.
    gain = level + (np.sqrt(level) - level) * low * np.exp(-off / 0.5) if level < 1 else np.full_like(off, level)
    return ENCODED[np.rint(65535 * np.clip(light * gain[..., None], 0, 1)).astype(np.uint16)]
