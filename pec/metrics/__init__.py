"""What predictions over many clouds are worth."""
