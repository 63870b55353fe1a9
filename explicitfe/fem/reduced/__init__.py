"""Reduced models: bodies in few unknowns, made from solutions of the full model, with an estimate of what the reduction costs."""
