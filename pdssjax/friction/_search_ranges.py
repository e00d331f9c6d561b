"""Search ranges of parameters that friction laws share: stiffness, damping, force, velocity."""


def lugre_ranges(mass: float, acceleration: float, rate: float) -> tuple[tuple[float, float], ...]:
    """Ranges for stiffness [N/m], damping [N s/m] and breakaway force [N] of a bristle contact."""
    stiff = mass * (0.2 * rate) ** 2, mass * (1.5 * rate) ** 2
    critical = 2.0 * mass * 0.5 * rate
    return stiff, (0.02 * critical, critical), (0.004 * mass * acceleration, 0.3 * mass * acceleration)


def stribeck_range(acceleration: float, rate: float) -> tuple[float, float]:
    """Range for the Stribeck velocity [m/s]: fractions of the peak velocity of the platform."""
    return 1e-3 * acceleration / rate, 0.3 * acceleration / rate
