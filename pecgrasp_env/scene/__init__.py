"""What lies on the table, and how it came to lie there."""
