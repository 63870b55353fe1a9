"""Effects of the material: what an element answers to its deformation."""
