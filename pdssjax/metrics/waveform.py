"""What samples of a voltage tell of the drive that made them."""

import dataclasses

from .flank_timing import Timing

AT_ZERO = 0.02
"""Part of the voltage up to which a level counts as 0 V."""


@dataclasses.dataclass(frozen=True)
class Waveform:
    """A drive as a study describes it, in SI, on the clock of the samples."""

    name: str
    """Member of the family of drives; "sampled" where no other explains the samples."""
    numbers: dict[str, float]
    """By field of the drive."""
    direction: str
    """Of a sawtooth or a cycloidal: "forward" or "backward"; else ""."""
    start: float
    """When the drive starts [s]: t = 0 of the study."""
    begins: str
    """"seen": it rests in the record before, at the level it is counted from; "held": of samples, at another voltage;
    "clock": the clock's zero begins a cycle; "running": it ran before;
    "motion": the motion sets in with the record."""
    misfit: float
    """Root mean square of what the waveform leaves, in parts of the voltage."""
    uncertain: tuple[str, ...] = ()
    """Fields that the samples tell only within a bound, in words."""
    timing: Timing | None = None
    """Of a step, a sawtooth or a cycloidal."""
    voltage_error: float = 0.0
    """Standard error of the voltage [V]; of a sawtooth, of what its slow flank would come to in a whole period."""
    frequency_error: float = 0.0
    """Standard error of the frequency by the noise, in parts of it."""
    counted_from: float = 0.0
    """Level at which it rests, or to which it returns, in place of 0 V [V]: its voltage is counted from there."""

    @property
    def has_fast_flanks(self) -> bool:
        """A cycle is a slow and a fast flank: the drive of a walk."""
        return self.name in ("sawtooth", "cycloidal")
