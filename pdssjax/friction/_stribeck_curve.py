"""The Stribeck curve, and what makes a step resolve it: a curve as an error term, a guard far out where it is flat.

R. Stribeck, Zeitschrift des Vereines deutscher Ingenieure 46, 1902; the thesis's (5.10).
"""

from ..core import ScalarLike
from ..integration import Term, exp

CURVE = 1e-8
"""The Stribeck curve, from 1 at rest to 0 far out, as a displacement [m]: how well a step resolves it.

The motion hardly feels how the curve bends within a step; its derivatives by the curve's parameters do.
"""


def stribeck_curve(v: Term, f_c: ScalarLike, f_s: ScalarLike, v_s: ScalarLike) -> Term:
    """f_c + (f_s - f_c) exp(-(v/v_s)^2) (5.10) [N], of a series or of a number.

    Between f_c and f_s whichever is larger: with f_s < f_c friction grows with the velocity.
    """
    x = v * (1.0 / v_s)
    return exp(x * x * (-1.0)) * (f_s - f_c) + f_c


def stribeck_guard(fast: Term, v: Term, sign: ScalarLike, v_s: ScalarLike, far: ScalarLike = 4.0) -> Term:
    """The guard of the flag of `fast` sliding, far out where the Stribeck curve is flat.

    The Taylor coefficients of e^(-x^2) about x grow up to the order 2 x^2 or so before they fall.  Far
    out the first dozen is small and says nothing of the others: a step that brakes would run past
    the curve unseen.  At x = 4, where e^-16 is left, it is seen.  So steps end at `far` times
    v_s when braking, and past 1.1 times that when speeding up.
    """
    speed = v * (sign / v_s)
    return (speed - far) * fast + (1.1 * far - speed) * (1.0 - fast)
