"""Error models, one a file: models of the residuals, and the errors of the parameters by them."""
