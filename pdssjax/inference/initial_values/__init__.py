"""Where a fit begins when the study does not say: found from the records."""
