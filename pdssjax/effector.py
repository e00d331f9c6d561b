"""The end-effector: a mass that rides on the platform, held by friction alone (5.23)."""

import equinox as eqx

from .quantity import quantity


class Effector(eqx.Module):
    """m_e x_e'' = F + load."""

    mass: float = quantity(0.086, "kg")
    """Moving mass m_e [kg]."""
    load: float = quantity(0.0, "N", positive=False, optional=True)
    """Constant force on the end-effector, positive forward [N]."""
