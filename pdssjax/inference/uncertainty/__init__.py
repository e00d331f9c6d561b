"""The uncertainty of an estimate: error models, amplification, profiles, bootstrap and posterior of an estimate."""
