"""The scene in `simulate`, under the conditions of the visit."""

from omnisight.pipeline.simulation.simulate_options import SimulateOptions
from omnisight.simulation.daylight import Daylight, stops, with_daylight
from omnisight.simulation.scene import Scene
from omnisight.simulation.scenes import scene_named

# Change of the light that is reported, because images become too dark or too bright.
REPORTED_STOPS = 1.0


def visited_scene(options: SimulateOptions) -> tuple[Scene, list[str]]:
    """Return the scene under its conditions, and warnings.

    Raises
    ------
    ValueError
        If the scene or a condition is unknown, or does not apply to the scene.
    """
    conditions = options.conditions
    daylight = Daylight(conditions.time, conditions.weather, options.motion_sensors.origin[0])
    usual = scene_named(options.scene, options.seed).with_visit(conditions.visit, options.seed)
    usual = usual.with_traffic() if conditions.traffic else usual
    if daylight.time is None and daylight.weather == "clear":
        return usual, []
    scene = with_daylight(usual, daylight, options.seed)
    change = stops(scene, usual)
    if abs(change + options.exposure) < REPORTED_STOPS:
        return scene, []
    return scene, [f"the light is {change:+.1f} stops of the usual; add --exposure {-change:.1f} for images as bright"]
