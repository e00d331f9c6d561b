"""Initial values of a fit, from the records, where the study gives none."""
