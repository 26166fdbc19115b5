"""Arms with published lengths."""

import numpy as np

from pecgrasp_env.robot.arm_lengths import JOINT_LIMITS, ArmLengths


def _of(d, a, footprint):
    half = np.pi / 2
    rows = [[0, d[0], half], [a[0], 0, 0], [a[1], 0, 0], [0, d[1], half], [0, d[2], -half], [0, d[3], 0]]
    return ArmLengths(np.array(rows, float), JOINT_LIMITS, footprint)


UR3 = _of((0.1519, 0.11235, 0.08535, 0.0819), (-0.24365, -0.21325), 0.128)
UR10 = _of((0.1273, 0.163941, 0.1157, 0.0922), (-0.612, -0.5723), 0.19)
UR10E = _of((0.1807, 0.17415, 0.11985, 0.11655), (-0.6127, -0.57155), 0.19)

# theta, a, d, alpha by which a UR10's factory corrected it, as its maker's driver is tested with.
CORRECTIONS = np.array(
    [
        [-7.290070070824746e-05, 4.6311376834935676e-05, 0.00065609212979853, 0.000211987863869334],
        [-0.01713897289704999, -0.00012568315331862312, 1.4442162376284788, -0.0072553625957652995],
        [-0.03707159413492756, 0.00186216581161458, 0.854147723854608, -0.013483226769541364],
        [0.054279462160583214, 9.918593870679266e-05, -2.2989425877563705, 0.0013495820227329425],
        [1.488984257025741e-07, 4.215462720453189e-06, -1.573498686836816e-05, -0.001263136163679901],
        [1.551499479707493e-05, 0.0, 1.9072435590711256e-05, 0.0],
    ]
)


def measured(arm, share=1.0):
    """An arm that departs from its type as the UR10 did, or by a share of that."""
    return arm.with_measured(np.column_stack([np.zeros(6), arm.dh]) + share * CORRECTIONS)


MEASURED_UR10 = measured(UR10)
