"""The parts of a rig besides piezo and friction, by the name under which a study lists their parameters."""

from .amplifier import Amplifier
from .effector import Effector
from .sensor import Sensor
from .stop import Stop

PARTS: dict[str, type] = {"effector": Effector, "stop": Stop, "amplifier": Amplifier, "sensor": Sensor}
"""By its name, as in "effector.mass", the class whose `quantity` fields are its parameters."""
