"""Where the camera is: hand-eye calibration with a printed board, and a check of it without one."""
