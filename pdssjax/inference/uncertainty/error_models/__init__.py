"""Error models, one a file: what the residuals are taken for, and what follows for the errors of the parameters."""
