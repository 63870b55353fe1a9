"""A compact law composed from data, where no effect of the list explains what is left."""
