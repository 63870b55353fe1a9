"""The frame of every page that the program writes: one template, one style, tables and charts without a drawing library."""
