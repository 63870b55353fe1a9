"""Effects of the muscles that drive a tongue."""
