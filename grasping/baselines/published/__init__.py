"""The planner of the dissertation's chapter 5, as its text has it."""
