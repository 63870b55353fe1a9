"""Effects of the tool and of the rig that drives it."""
