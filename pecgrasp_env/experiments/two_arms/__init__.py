"""How often two arms lift what is long or heavy level, and how often one does."""
