"""How sure: covariance, error models, amplification, profiles, bootstrap and posterior of an estimate."""
