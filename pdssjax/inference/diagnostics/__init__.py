"""What a fit tells beside its numbers: combinations the data determine, records that disagree."""
