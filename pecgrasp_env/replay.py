"""ManiSkill's replay tool, which knows SelectiveGrasp-v1 then: `python -m pecgrasp_env.replay --traj-path FILE.h5`.

All its options (`--help`) but one hold: ``--target-control-mode`` copies the gripper's action as it is, and metres are
none of [-1, 1]. Record in the control mode that is wanted instead.
"""

import multiprocessing

if __name__ == "__main__":
    from mani_skill.trajectory.replay_trajectory import main, parse_args

    multiprocessing.set_start_method("spawn")  # the renderer does not survive a fork
    main(parse_args())
