"""Forces against the velocity of nodes: drag of the air, and damping of the tissue beside attached masses.

A node feels F_k = -(c_k + q_k |v|) v_k along each axis k. For the air, c_k and q_k are proportional to half the sum of the
absolute areas of its surface along k, so that the areas of all nodes of a convex body add up to its silhouette. With q = rho
C_d / 2 per area this is the usual law of drag (Batchelor 1967, section 5.11). The velocity is that of the half step before, which
keeps the step explicit.
"""

from __future__ import annotations

import math

from explicitfe.platform.compiled.jit import leaf


@leaf
def add_drag(force, v, drag):
    """Add the drag at velocity v to the node rows."""
    for entry in range(len(drag.node)):
        node = drag.node[entry]
        x, y, z = v[node, 0], v[node, 1], v[node, 2]
        speed = math.sqrt(x * x + y * y + z * z)
        force[node, 0] -= (drag.linear[entry, 0] + drag.quadratic[entry, 0] * speed) * x
        force[node, 1] -= (drag.linear[entry, 1] + drag.quadratic[entry, 1] * speed) * y
        force[node, 2] -= (drag.linear[entry, 2] + drag.quadratic[entry, 2] * speed) * z
