"""Networks that judge or propose grasps on the cloud of one object, each from its paper's facts."""
