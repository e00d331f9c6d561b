"""An actuator that walks: the contact of (5.22) in its first reading, which jumps at reversals, with feedback."""

from parts import AnisotropicLuGre, Coulomb, Sawtooth, SecondOrder

from pdssjax import Actuator, Effector
from pdssjax.simulation import StickSlip

HORIZON = 0.045


def system(factor):
    law = AnisotropicLuGre(f_ss_b=0.5458 * factor)
    return StickSlip(Actuator(SecondOrder(mass=0.5), law, Effector(0.086), feedback=True), Sawtooth(64.0, 50.0, 9e-4))


def settling():
    """A contact that sticks for good while the platform rings on."""
    return StickSlip(Actuator(SecondOrder(damping_ratio=0.05), Coulomb(), Effector(0.086)), Sawtooth(64.0, 50.0, 1e-3))
