"""What several rooms of this package share."""
