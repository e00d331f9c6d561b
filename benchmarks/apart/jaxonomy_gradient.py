"""The walk of `benchmarks.gradient` by jaxonomy, in jaxonomy's own environment: it needs another JAX than pdssjax.

Imports nothing of pdssjax.  Reads voltage, frequency, cycles, parameters and tolerance as JSON from the command line;
prints the end-effector's place at the end [um], its derivatives by the logarithms, and the seconds as JSON.
"""

import json
import sys

import jax
import jax.numpy as jnp
from jaxonomy import LeafSystem, SimulatorOptions, simulate  # pyright: ignore[reportMissingImports]
from timed_gradient import tell

NAMES = tuple("omega damping gain mass s0_a s0_b s1_a s1_b f_ss_a f_ss_b".split())
RATE = 1e3
"""Speeds are in um times it a second, so that all states are of like size."""
MOST_EVENTS = 4000


class Rig(LeafSystem):  # pyright: ignore[reportUntypedBaseClass]
    """Platform and effector; the sense of sliding is a mode, changed where the relative speed passes zero."""

    def __init__(self, voltage: float, frequency: float, parameters: list[float]):
        super().__init__(name="rig")
        self.voltage, self.frequency = voltage, frequency
        for name, value in zip(NAMES, parameters, strict=True):
            self.declare_dynamic_parameter(name, value)
        self.declare_discrete_state(default_value=jnp.array(0.0))
        self.declare_continuous_state(default_value=jnp.zeros(5), ode=self.field)
        self.declare_default_mode(0)
        self.declare_periodic_update(self.drop, period=1.0 / frequency, offset=1.0 / frequency)
        self.declare_zero_crossing(self.slip, start_mode=0, end_mode=1, direction="positive_then_non_positive")
        self.declare_zero_crossing(self.slip, start_mode=1, end_mode=0, direction="negative_then_non_negative")

    def drop(self, time, state, **p):
        return state.discrete_state + 1.0

    def slip(self, time, state, **p):
        return state.continuous_state[1] - state.continuous_state[3]

    def field(self, time, state, **p):
        y, w, _, w_e, z = state.continuous_state
        u = self.voltage * (self.frequency * time - state.discrete_state)
        v, forward = (w - w_e) * RATE, state.mode == 0
        s0, s1, f_ss = (jnp.where(forward, p[f"{name}_a"], p[f"{name}_b"]) for name in ("s0", "s1", "f_ss"))
        rate = v - s0 * jnp.where(forward, v, -v) / (1e6 * f_ss) * z
        force = s0 * z + s1 * rate
        push = p["omega"] ** 2 * (1e6 * p["gain"] * u - y) - 2.0 * p["damping"] * p["omega"] * w * RATE
        return jnp.array([w * RATE, push / RATE, w_e * RATE, force / p["mass"] / RATE, rate])


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    asked = json.loads(sys.argv[1])
    parameters = asked["parameters"]
    rig = Rig(asked["voltage"], asked["frequency"], parameters)
    base, tolerance = rig.create_context(), asked["tolerance"]
    options = SimulatorOptions(
        diff_mode=asked["mode"],
        max_major_steps=MOST_EVENTS,
        rtol=tolerance,
        atol=tolerance,
        ode_solver_method="dopri5",
        save_time_series=False,
    )

    def end(logarithms):
        context = base
        for number, name in enumerate(NAMES):
            context = context.with_parameter(name, parameters[number] * jnp.exp(logarithms[number]))
        span = 0.0, asked["cycles"] / asked["frequency"]
        return simulate(rig, context, span, options=options).context.continuous_state[2]

    tell(end, asked["mode"], len(NAMES))


if __name__ == "__main__":
    main()
