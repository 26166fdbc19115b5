"""What the robot looks like: each link's surfaces and materials, in the link's frame, drawn from its dimensions.

Own shapes after the look of the real arm, gripper and camera: light grey tubes and joint housings with blue-grey caps
and dark seals for the UR5, a black fork with parallel bars for the 2F-140, a silver D435 on a bracket.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pecgrasp_env.robot import gripper_linkage as lk
from pecgrasp_env.robot.kinematics import COUPLER, T_TOOL0_CAMERA
from pecgrasp_env.robot.visual_surfaces import Surface, axes, box, dome, lathe, loft, outline, plate, tube


@dataclass(frozen=True)
class Material:
    color: tuple[float, float, float]  # linear RGB
    metallic: float
    roughness: float


ALUMINIUM = Material((0.66, 0.67, 0.68), 0.2, 0.45)
CAP = Material((0.20, 0.38, 0.55), 0.0, 0.4)
SEAL = Material((0.05, 0.05, 0.055), 0.0, 0.7)
STEEL = Material((0.55, 0.56, 0.58), 0.8, 0.3)
HOUSING = Material((0.035, 0.035, 0.04), 0.1, 0.45)
LINK = Material((0.10, 0.10, 0.11), 0.4, 0.4)
RUBBER = Material((0.30, 0.30, 0.30), 0.0, 0.9)
GLASS = Material((0.01, 0.01, 0.015), 0.0, 0.1)

Part = tuple[Surface, Material]
X, Y, Z = np.eye(3)


def link_parts() -> dict[str, list[Part]]:
    """Visual parts of every drawn link, plus `inner_knuckle`, the parallel of a crank (see `knuckles`)."""
    parts = {
        "base_link": _base(),
        "shoulder_link": _shoulder(),
        "upper_arm_link": _upper_arm(),
        "forearm_link": _forearm(),
        "wrist_1_link": _wrist(output=-Y, stub=0.0465),
        "wrist_2_link": _wrist(output=Y, stub=0.0365),
        "wrist_3_link": _flange(),
        "gripper_base": _palm(),
        "wrist_camera": _camera(),
        "inner_knuckle": _knuckle(),
    }
    for side, name in ((-1, "left"), (1, "right")):
        parts[f"{name}_crank"] = _crank(outward=side)
        parts[f"{name}_finger"] = _finger(inward=-side)
    return parts


# -------------------------------------------------------------------------------------------------------- UR5


def _housing(radius: float, low: float, high: float, T: np.ndarray, cap: str = "", seal: str = "") -> list[Part]:
    """A joint housing about local z: `cap` and `seal` name the ends ("low", "high") that carry one."""
    parts: list[Part] = [(tube(radius, low, high, 0.004), ALUMINIUM)]
    flip = axes(-Z, X)
    if cap == "high":
        parts.append((dome(radius - 0.0015, high - 0.001, 0.011), CAP))
    elif cap == "low":
        parts.append((dome(radius - 0.0015, -low - 0.001, 0.011).moved(flip), CAP))
    if seal == "high":
        parts.append((tube(radius - 0.002, high - 0.002, high + 0.0015, 0.0005), SEAL))
    elif seal == "low":
        parts.append((tube(radius - 0.002, low - 0.0015, low + 0.002, 0.0005), SEAL))
    return [(surface.moved(T), material) for surface, material in parts]


def _base() -> list[Part]:
    body = lathe([(0.0745, 0), (0.0745, 0.009), (0.073, 0.011), (0.062, 0.012), (0.0595, 0.015), (0.0595, 0.0255)])
    screws = [
        tube(0.0055, 0.011, 0.0145, 0.001).moved(_at(0.066 * _circle(a))) for a in np.pi / 4 + np.arange(4) * np.pi / 2
    ]
    cable = box((0.026, 0.022), 0, 0.016).moved(axes(-X, Y, (-0.055, 0, 0.0135)))
    return [
        (body, ALUMINIUM),
        (tube(0.0575, 0.0245, 0.0275, 0.0005), SEAL),
        (cable, SEAL),
        *((s, STEEL) for s in screws),
    ]


def _shoulder() -> list[Part]:
    neck = tube(0.0595, -0.0615, 0.0, 0.003)
    return [(neck, ALUMINIUM), *_housing(0.0595, -0.062, 0.0735, axes(-Y, X), cap="low", seal="high")]


def _upper_arm() -> list[Part]:
    beam = lathe(
        [(0.052, 0), (0.052, 0.06), (0.0505, 0.09), (0.048, 0.2), (0.0485, 0.33), (0.050, 0.365), (0.050, 0.425)]
    )
    return [
        *_housing(0.0595, 0.0755, 0.195, _at((0, 0, 0)), cap="high"),
        (beam.moved(axes(-X, Y, (0, 0, 0.13585))), ALUMINIUM),
        *_housing(0.0565, 0.0765, 0.195, _at((-0.425, 0, 0)), cap="high", seal="low"),
        (tube(0.0535, 0.0, 0.006, 0.001).moved(axes(-X, Y, (-0.064, 0, 0.13585))), SEAL),
        (tube(0.0520, 0.0, 0.006, 0.001).moved(axes(-X, Y, (-0.360, 0, 0.13585))), SEAL),
    ]


def _forearm() -> list[Part]:
    beam = lathe(
        [(0.045, 0), (0.045, 0.06), (0.042, 0.1), (0.038, 0.18), (0.037, 0.30), (0.0375, 0.34), (0.0375, 0.392)]
    )
    return [
        *_housing(0.0565, -0.043, 0.0735, _at((0, 0, 0)), cap="low"),
        (beam.moved(axes(-X, Y, (0, 0, 0.0165))), ALUMINIUM),
        *_housing(0.0435, -0.028, 0.0600, _at((-0.39225, 0, 0)), cap="low", seal="high"),
        (tube(0.0465, 0.0, 0.006, 0.001).moved(axes(-X, Y, (-0.061, 0, 0.0165))), SEAL),
        (tube(0.0395, 0.0, 0.006, 0.001).moved(axes(-X, Y, (-0.338, 0, 0.0165))), SEAL),
    ]


def _wrist(output: np.ndarray, stub: float) -> list[Part]:
    return [
        *_housing(0.0435, -0.0465, 0.043, _at((0, 0, 0)), cap="high"),
        (tube(0.0435, 0.0, stub - 0.0015, 0.003).moved(axes(output, X)), ALUMINIUM),
        (tube(0.0415, stub - 0.003, stub, 0.0005).moved(axes(output, X)), SEAL),
    ]


def _flange() -> list[Part]:
    body = lathe(
        [(0.0365, -0.0445), (0.0375, -0.0435), (0.0375, -0.016), (0.036, -0.0145), (0.0315, -0.012), (0.0315, 0)]
    )
    plug = tube(0.006, 0, 0.012, 0.001).moved(axes(X, Z, (0.034, 0, -0.028)))
    return [(body, ALUMINIUM), (plug, SEAL)]


# ----------------------------------------------------------------------------------------------------- 2F-140
# Flat parts are drawn as plates in (y, z) of the gripper, extruded along the hinge axis x.

_HINGE = axes(X, Y)  # local x, y, z -> gripper y, z, x


def _palm() -> list[Part]:
    coupler = tube(0.0375, -COUPLER, 0.0, 0.0008)
    # From the round mount to a block that is wide along the closing axis.
    sections = [
        (0.0, 0.0, 0.0, 0.0365),
        (0.001, 0.0, 0.0, 0.0375),
        (0.014, 0.0, 0.0, 0.0375),
        (0.022, 0.010, 0.018, 0.0235),
        (0.030, 0.014, 0.030, 0.016),
        (0.040, 0.015, 0.034, 0.014),
        (0.0445, 0.015, 0.034, 0.012),
    ]
    body = loft([_rounded_loop(z, x, y, r) for z, x, y, r in sections])
    parts: list[Part] = [(coupler, STEEL), (body, HOUSING)]
    cheek = [
        (-0.030601, 0.0549, 0.0105),
        (0.030601, 0.0549, 0.0105),
        (0.0127, 0.0614, 0.0095),
        (-0.0127, 0.0614, 0.0095),
    ]
    foot = [(-0.036, 0.036, 0.008), (0.036, 0.036, 0.008)]
    for x in (-0.0165, 0.0165):  # a fork that carries the pins
        parts.append((plate([*cheek, *foot], x - 0.0035, x + 0.0035).moved(_HINGE), HOUSING))
    for y, z, radius in (
        (lk.CRANK_PIVOT_Y, lk.CRANK_PIVOT_Z, 0.006),
        (-lk.CRANK_PIVOT_Y, lk.CRANK_PIVOT_Z, 0.006),
        (lk.KNUCKLE_PIVOT_Y, lk.KNUCKLE_PIVOT_Z, 0.0042),
        (-lk.KNUCKLE_PIVOT_Y, lk.KNUCKLE_PIVOT_Z, 0.0042),
    ):
        parts.append((tube(radius, -0.0215, 0.0215, 0.001).moved(_HINGE @ _at((y, z, 0))), STEEL))
    return parts


def _crank(outward: int) -> list[Part]:
    """Crank frame: z along the crank from the palm's pin to the finger's, y outwards times `outward`."""
    top = lk.CRANK_LENGTH
    bar = [(0, 0, 0.0095), (outward * 0.002, 0.035, 0.0085), (outward * 0.001, top - 0.02, 0.0075), (0, top, 0.0080)]
    # Two cheeks outside, one web between: the finger and the palm fit between the cheeks.
    parts: list[Part] = [(plate(bar, x - 0.003, x + 0.003).moved(_HINGE), LINK) for x in (-0.0095, 0.0095)]
    web = [(outward * 0.003, 0.016, 0.0065), (outward * 0.003, top - 0.022, 0.0055)]
    parts.append((plate(web, -0.009, 0.009).moved(_HINGE), LINK))
    parts.append((tube(0.005, -0.0145, 0.0145, 0.001).moved(_HINGE @ _at((0, top, 0))), STEEL))
    return parts


def _knuckle() -> list[Part]:
    """The parallel, in a frame like the crank's, at its own pin."""
    bar = [(0, 0, 0.0056), (0, 0.03, 0.0046), (0, lk.CRANK_LENGTH, 0.0052)]
    pin = tube(0.0032, -0.0125, 0.0125, 0.0008).moved(_HINGE @ _at((0, lk.CRANK_LENGTH, 0)))
    return [(plate(bar, -0.0105, 0.0105).moved(_HINGE), LINK), (pin, STEEL)]


def _finger(inward: int) -> list[Part]:
    """Finger frame: origin at the crank's pin, z along the approach, y towards the other finger times `inward`."""
    back = lk.PAD_CENTRE_Y - lk.PAD_THICKNESS / 2
    pin_y, pin_z = lk.CRANK_PIVOT_Y - lk.KNUCKLE_PIVOT_Y, lk.KNUCKLE_PIVOT_Z - lk.CRANK_PIVOT_Z
    low, high = lk.PAD_CENTRE_Z - lk.PAD_LENGTH / 2, lk.PAD_CENTRE_Z + lk.PAD_LENGTH / 2
    root = [(0, 0, 0.0075), (pin_y, pin_z, 0.0065), (back - 0.006, low + 0.004, 0.006)]
    blade = [
        (back - 0.0055, low + 0.002, 0.0055),
        (back - 0.003, high - 0.003, 0.003),
        (back - 0.0075, low + 0.020, 0.005),
    ]
    shapes = [
        (plate([(inward * y, z, r) for y, z, r in root], -0.006, 0.006), LINK),
        (plate([(inward * y, z, r) for y, z, r in blade], -0.0115, 0.0115), LINK),
    ]
    pad = box((lk.PAD_WIDTH, lk.PAD_LENGTH), 0, lk.PAD_THICKNESS, 0.0018)
    to_pad = axes((0, inward, 0), (1, 0, 0), (0, inward * back, lk.PAD_CENTRE_Z))
    return [*((shape.moved(_HINGE), material) for shape, material in shapes), (pad.moved(to_pad), RUBBER)]


# -------------------------------------------------------------------------------------------------------- D435


def _camera() -> list[Part]:
    """Optical frame: body behind the lens plane, bracket back to the coupler."""
    left, right = 0.0175 - 0.0325, 0.0175 + 0.0325  # the optical frame is the left imager's, 17.5 mm off the middle
    body = plate([(left, 0, 0.0125), (right, 0, 0.0125)], -0.0255, -0.0015, 0.002)
    face = plate([(left, 0, 0.0108), (right, 0, 0.0108)], -0.002, -0.0008, 0.0003)
    parts: list[Part] = [(body, STEEL), (face, GLASS)]
    for x, radius in ((-0.015, 0.0038), (0.0, 0.0045), (0.029, 0.0035), (0.050, 0.0045)):  # colour, left, light, right
        parts.append((tube(radius, -0.001, -0.0004, 0.0002).moved(_at((x, 0, 0))), SEAL))
    reach, level = -T_TOOL0_CAMERA[1, 3], -T_TOOL0_CAMERA[2, 3]  # the flange's axis and face in this frame
    arm = plate(
        [(0, 0, 0.014), (0.022, reach - 0.030, 0.008), (-0.022, reach - 0.030, 0.008)], level + 0.0005, level + 0.0055
    )
    post = box((0.026, 0.014), level + 0.005, -0.0250, 0.003)
    return [*parts, (arm, HOUSING), (post, HOUSING)]


def _rounded_loop(z: float, x: float, y: float, radius: float) -> np.ndarray:
    """A loop at height z: a rectangle of half sizes x, y, grown by `radius`."""
    corners = [(x, y, radius), (-x, y, radius), (-x, -y, radius), (x, -y, radius)]
    loop = outline(corners)
    return np.column_stack([loop, np.full(len(loop), z)])


def _at(origin: np.ndarray | tuple[float, float, float]) -> np.ndarray:
    return axes(Z, X, origin)


def _circle(angle: float) -> np.ndarray:
    return np.array([np.cos(angle), np.sin(angle), 0.0])
