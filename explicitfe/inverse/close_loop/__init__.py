"""What measured data say that a model lacks: residual, fingerprints of effects, refit, verdict."""
