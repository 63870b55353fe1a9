"""Is the tool right about data with an undeclared effect? Cases with a sealed truth, and what the tool made of them."""
