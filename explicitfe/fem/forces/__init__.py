"""What pushes a node: one file an effect.

``internal`` stress and hourglass forces of the elements; ``dead`` nodal forces of fixed direction (muscles along their
reference directions, gravity, dead loads); ``follower`` tense fibres that turn with the deformation. Each is a leaf or a
template that adds its force to the node rows; ``solve/step`` calls them. Mass-proportional damping stands in the step
itself, since it acts on the velocity that the step is solving for.
"""
