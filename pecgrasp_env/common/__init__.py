"""What several rooms of this package share, and the doctor, who says what works on this machine."""
