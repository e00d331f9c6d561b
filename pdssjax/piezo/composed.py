"""A stack put together: hysteresis, asymmetry and creep, on static, first-order, second-order or rod dynamics.

    e = C u + a_2 u^2 + a_3 u^3 + … + sum of p_j (u - s_j) + sum of c_i      the aim
    c_i' = (k_i u - c_i) / t_i,   t_i = t_1, 10 t_1, 100 t_1, …              creep
    y = e;   tau y' + y = e;   or y'' + 2 xi w y' + w^2 y = w^2 e  [ - F / m_g (5.25) ]

`piezo = { dynamics = "static", hysteresis = { law = "play", elements = 8, asymmetry = 3 }, creep = {
elements = 3 } }` names one.  Each law of hysteresis gives voltages s_j that follow u and stop:

- `play`: s_j' = u' while |s_j| < r_j, else the element slips, until u turns; u - s_j is the play operator, and
  the sum that of Prandtl and Ishlinskii.  Its loops look the same from both ends; the polynomial of degree
  `asymmetry` is what a real stack adds.  r_j = r j/n.
- `maxwell-slip`: the same elements, told by what each holds back: C u - sum of b_j s_j; C is the gain in the end.
- `bouc-wen`: one s with s' = u' - b |u'| s - g u' |s|.

The elements do not know how fast the voltage goes, so a jump is passed exactly.  All weights are displacements
per volt, and the platform's motion is linear in them: fits project them out.  What the stack went
through before t = 0 is told by `initial_voltage`, at which it had long rested, `initial_peak`, to which it
had been driven before that, and what creep was `initial_creep_i` ahead of that rest.

P. Krejci and K. Kuhnen, IEE Proceedings Control Theory and Applications 148(3), 2001; K. Kuhnen, European Journal
of Control 9(4), 2003 (modified, with asymmetry); creep as in `creep`; Bouc-Wen as in `bouc-wen`.
"""

from ._composed_model import ComposedModel, composed_class, composed_variant
from ._composition import Composition

Composed: type[ComposedModel] = composed_class(Composition())


def __getattr__(name: str) -> type[ComposedModel]:
    """The class "Composed:static+play-8", say: so that others than the usual one can be pickled."""
    begin, mark, text = name.partition(":")
    if begin != "Composed" or not mark:
        raise AttributeError(name)
    return composed_variant(text)
