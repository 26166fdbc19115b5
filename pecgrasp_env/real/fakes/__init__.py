"""Stand-ins that speak the vendors' protocols on real sockets and move a plant: joints that follow, or a simulation.

`FakeRobot` is a UR controller with a Robotiq URCap; it runs in a process of its own (`pecgrasp fake-robot`).
"""
