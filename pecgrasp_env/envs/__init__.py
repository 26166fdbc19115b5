"""The task SelectiveGrasp-v1, batched, and SelectiveGraspSingle-v1, for one robot."""
