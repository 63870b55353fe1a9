"""A stored run in three dimensions: the body with a field, bones, muscle fibres, the shape at rest."""
