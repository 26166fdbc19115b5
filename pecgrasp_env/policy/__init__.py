"""The scripted policy: look, choose, plan, pick."""

from pecgrasp_env.policy.scripted import ScriptedPolicy

__all__ = ["ScriptedPolicy"]
