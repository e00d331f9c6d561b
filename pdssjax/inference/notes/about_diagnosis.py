"""Records that contradict each other, in words."""

from ...study import Diagnosis
from ..poor_fit import contradicting
from .words import listed

_LINEAR = 100.0
"""Standard errors up to which a linear step is quoted: it is exact where parameters hardly move."""


def about_agreement(diagnosis: Diagnosis | None, method: str = "joint") -> list[str]:
    """Records, or all of one direction or kind, that ask for other parameters than the rest."""
    found = [] if diagnosis is None else contradicting(diagnosis.agreement)
    if not found:
        return []
    worst = max(found, key=lambda agreement: agreement.sigmas)
    path, shift = worst.largest()
    far = f"{abs(shift):.2g} standard errors" if abs(shift) < _LINEAR else f"over {_LINEAR:.0f} standard errors"
    path += "" if method == "joint" else " of a joint fit"
    names = listed(f'"{name}"' for name in worst.records)
    alone = len(worst.records) == 1
    others = "the other records" if alone else f"those of another {worst.what}"
    others_too = {name for agreement in found for name in agreement.records} - set(worst.records)
    also = f" So do {listed(chr(34) + name + chr(34) for name in sorted(others_too))}, less." if others_too else ""
    return [
        f"{names} {'contradicts' if alone else 'contradict'} {others} ({worst.sigmas:.3g} standard deviations beyond "
        f"chance): without {'it' if alone else 'them'} {path} would be {far} "
        f"{'larger' if shift > 0 else 'smaller'}.{also} These parameters do not explain all: look for a wrong "
        "voltage, direction, unit or sign, a surface that differs, a law that lacks something, or a better optimum "
        "elsewhere (--starts 50)."
    ]
