"""From implicit shapes and mesh files to what is seen and what is touched."""
