"""How often a policy lifts the right object: episodes, grids of them, tables and a page."""

from pecgrasp_env.common.outcomes import OUTCOMES
from pecgrasp_env.evaluation.episode import Episode, run_episode
from pecgrasp_env.evaluation.run import EvaluationError, Protocol, read_episodes, run_episodes

__all__ = ["OUTCOMES", "Episode", "EvaluationError", "Protocol", "read_episodes", "run_episode", "run_episodes"]
