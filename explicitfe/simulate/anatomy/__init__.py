"""Models: from a scenario, or Python objects, to a frozen description of the mechanics. Nothing here is compiled."""
