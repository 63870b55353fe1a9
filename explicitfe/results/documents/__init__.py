"""Documents that commands return and write as JSON, as types."""
