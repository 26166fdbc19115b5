"""How an episode of SelectiveGrasp-v1 may end; known without a simulator."""

# What each outcome is called, and its tone: well, badly (it did harm), or without success.
OUTCOME_WORDS = {
    "success": ("lifted", "good"),
    "wrong_object": ("wrong object lifted", "bad"),
    "off_table": ("pushed off the table", "bad"),
    "dropped": ("dropped", "warn"),
    "no_object": ("not found", "warn"),
    "no_grasp": ("no grasp found", "warn"),
    "missed": ("not held", "warn"),
    "timeout": ("out of time", "warn"),
    "error": ("program error", "bad"),
    "absent": ("rightly said not to be there", "good"),
    "denied": ("wrongly said not to be there", "bad"),
    "stranger": ("stranger lifted", "bad"),
}
OUTCOMES = tuple(OUTCOME_WORDS)
RIGHT = tuple(name for name, (_, tone) in OUTCOME_WORDS.items() if tone == "good")
# Only with strangers on the table, or where the asked-for class may be absent.
RARE = ("absent", "denied", "stranger")
