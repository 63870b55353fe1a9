"""What is learned from measurements: datasets, and the constants that fit them."""
