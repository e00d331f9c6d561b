"""The waveforms, stacks and laws that tests make, by name; the package names each by its file."""

from pdssjax.drive.cycloidal import Cycloidal as Cycloidal
from pdssjax.drive.sampled import Sampled as Sampled
from pdssjax.drive.sawtooth import Sawtooth as Sawtooth
from pdssjax.drive.sine import Sine as Sine
from pdssjax.drive.step import Step as Step
from pdssjax.drive.trapezoid import Trapezoid as Trapezoid
from pdssjax.drive.triangle import Triangle as Triangle
from pdssjax.friction.anisotropic_lugre import AnisotropicLuGre as AnisotropicLuGre
from pdssjax.friction.bliman_sorine import BlimanSorine as BlimanSorine
from pdssjax.friction.bristle import Bristle as Bristle
from pdssjax.friction.coulomb import Coulomb as Coulomb
from pdssjax.friction.dahl import Dahl as Dahl
from pdssjax.friction.elastoplastic import Elastoplastic as Elastoplastic
from pdssjax.friction.generalized_maxwell_slip import GeneralizedMaxwellSlip as GeneralizedMaxwellSlip
from pdssjax.friction.lugre import LuGre as LuGre
from pdssjax.friction.reset_integrator import ResetIntegrator as ResetIntegrator
from pdssjax.friction.simplified_lugre import SimplifiedLuGre as SimplifiedLuGre
from pdssjax.friction.stribeck import Stribeck as Stribeck
from pdssjax.piezo.bouc_wen import BoucWen as BoucWen
from pdssjax.piezo.creep import Creep as Creep
from pdssjax.piezo.distributed_rod import DistributedRod as DistributedRod
from pdssjax.piezo.maxwell_slip import MaxwellSlip as MaxwellSlip
from pdssjax.piezo.second_order import SecondOrder as SecondOrder
from pdssjax.piezo.static import Static as Static
