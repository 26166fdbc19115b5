"""Training of the networks that judge or propose grasps."""
