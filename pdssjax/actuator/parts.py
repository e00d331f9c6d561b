"""The parts of a rig besides piezo and friction, by the name under which a study lists their parameters."""

from .amplifier import Amplifier
from .effector import Effector
from .part_names import PART_NAMES
from .sensor import Sensor
from .stop import Stop

PARTS: dict[str, type] = dict(zip(PART_NAMES, (Effector, Stop, Amplifier, Sensor), strict=True))
"""By its name, as in "effector.mass", the class whose `quantity` fields are its parameters."""
