"""Two arms that lift one thing: what they see, which grasps they choose, how they carry them out."""
