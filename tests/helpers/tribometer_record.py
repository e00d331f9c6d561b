"""Where the record of a reciprocating tribometer is, beside the repository where it was developed; not part of it."""

from pathlib import Path

TRIBOMETER = Path(__file__).parents[3] / "shared" / "data" / "tribometer" / "reciprocating.tsv"
