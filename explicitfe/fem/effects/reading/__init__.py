"""Effects of the measurement: the model is what it is, and is read differently."""
