"""Pictures of results. What draws is imported when it is needed: a run without pictures does not wait for it."""
