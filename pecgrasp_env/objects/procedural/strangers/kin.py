"""Which things a person might call by one another's name."""

from __future__ import annotations

import re
from collections.abc import Iterable

__all__ = ["kin_of"]

# Names of forms of strangers and of classes of the catalogue, and words of people for what these may draw.
_GROUPS = tuple(
    frozenset(line.split())
    for line in (
        "joypad controller gamepad",
        "mouse trackball",
        "stapler",
        "plug_adapter plug adapter charger",
        "pliers cutter wire_cutter open_wire_cutter pincers clamp",
        "drill",
        "can tin cylinder",
        "box carton packet package cuboid slab",
        "bottle flask pump spray soap_pump",
        "mug cup tumbler pot glass goblet shell",
        "bowl basin shell",
        "dish plate saucer pan frying fryingpan skillet lid ashtray",
        "pump teapot kettle jug jerrican",
        "tray crate pierced_box shelf frame bracket",
        "ball sphere egg",
        "ring torus tape bracelet",
        "coil spring spiral whisk",
        "wand banana horn hose croissant boomerang cucumber sausage",
        "bent_rod hook key allen hexkey hairpin hanger crank",
        "tool hammer mallet screwdriver spatula spoon ladle racket paddle torch flashlight wrench spanner toothbrush",
        "cutlery spoon fork knife spatula",
        "stick pen pencil marker candle tube",
        "brush comb rake fork toothbrush hairbrush",
        "device remote phone telephone smartphone calculator keyboard radio",
        "slab phone smartphone soap wallet",
        "lamp tap mushroom",
        "vehicle car truck lorry train bus",
        "tapered toothpaste pouch pyramid wedge chisel",
        "fruit apple pear lemon orange peach plum pepper pumpkin tomato strawberry",
        "knobbly potato ginger stone rock bread sponge sock",
        "superquadric soap sponge pebble",
        "toy doll figure animal duck dinosaur horse dog pig piggybank",
        "glider airplane aeroplane plane propeller",
        "letter digit puzzle",
        "carved dice brick lego",
        "shears scissors tongs pruners compasses",
        "spectacles glasses eyeglasses goggles binoculars dumbbell",
        "headset headphones padlock horseshoe",
        "folding book laptop peg clothespin clip",
        "strap watch collar belt",
    )
)


def kin_of(classes: Iterable[str]) -> frozenset[str]:
    """Names of forms and of classes of the catalogue that are one of `classes` or kin of one, by the words in them.

    "007_Tuna-cans" has the words tuna, cans and can. What kin draws may be something else, and what a folder calls
    otherwise is no kin: likeness of shape is for the latter.
    """
    words = {name.lower() for name in classes}
    words |= {word for name in list(words) for word in re.split(r"[\W_\d]+", name) if word}
    words |= {word.removesuffix(end) for word in words for end in ("s", "es")}  # plurals
    return frozenset(words | {word for group in _GROUPS if group & words for word in group})
