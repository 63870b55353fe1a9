"""Elements: what a hex needs to know of its reference shape, and how it is kept from hourglassing."""
