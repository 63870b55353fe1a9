"""The statistics of the loop; nothing here knows of tissue."""
