"""Effects of the specimen: what it is made of and how it is held."""
