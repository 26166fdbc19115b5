"""Joint paths of the arm: past everything that was seen, straight down to a grasp and up again."""
