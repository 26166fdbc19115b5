"""PEC, its successor and the networks that they are compared with."""
