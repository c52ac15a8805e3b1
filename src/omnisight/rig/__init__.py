"""Several cameras on one body, and heads of the usual kinds to try things with."""

from omnisight.rig.heads import back_to_back, ladybug, surround_car
from omnisight.rig.rig import Rig, Sensor

__all__ = ["Rig", "Sensor", "back_to_back", "ladybug", "surround_car"]
