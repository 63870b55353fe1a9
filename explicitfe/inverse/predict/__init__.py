"""What a tissue answers in a measured test: constants and effects in, curves out."""
