"""Results in the formats of other programs: tables of points, arrays, meshes, surfaces."""
