"""How well poses of known objects are found: clouds with the truth, methods, the field's measures, tables."""
