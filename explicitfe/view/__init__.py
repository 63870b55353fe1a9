"""Pictures of results. Everything that draws is imported when it is needed: a run without pictures does not wait for it."""
