"""A depth frame or a cloud of a table → the clouds of the objects on it."""
