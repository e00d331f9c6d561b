"""A stack of elastoplastic elements behind an amplifier that limits its slew rate."""

from parts import Sawtooth, SecondOrder

from pdssjax import Amplifier, Sensor
from pdssjax.actuator import DrivenPlatform
from pdssjax.core import member
from pdssjax.simulation import PlatformOnly

HORIZON = 0.045
STACK = member("piezo", "composed:static+maxwell-slip-2")()


def system(factor):
    amplifier = Amplifier(bandwidth=2000.0, slew=2e4 * factor)
    return PlatformOnly(DrivenPlatform(STACK, amplifier), Sawtooth(64.0, 50.0, 9e-4))


def settling():
    """A platform that comes to its steady creep behind a slow sensor."""
    return PlatformOnly(DrivenPlatform(SecondOrder()), Sawtooth(64.0, 50.0, 1e-3), Sensor())
