"""From a model to its answer: steps of central differences, equilibria, single points."""
