"""Your own class of objects in one file: a function that draws an instance, generated into labelled clouds.

    python examples/08_own_object_class.py

makes a small data set of it. The same by the command, for which a class goes by its dotted name:

    export PYTHONPATH=examples            # the folder of your file
    pecgrasp generate 'objects.classes=[08_own_object_class.dumbbell,stapler,mug]' out=clouds
    pecgrasp contact-sheet 'objects.classes=[08_own_object_class.dumbbell]'

Finished clouds are kept, even where this file has changed since: after an edit give a new out=, or delete the old one.
"""

import tempfile

import numpy as np

from pecgrasp_env.objects.meshing.shapes import disc
from pecgrasp_env.objects.model import Draft


def dumbbell(rng: np.random.Generator) -> Draft:
    """A bar with a plate at either end, lying along y: coloured shapes in millimetres, and the mass in kilograms.

    Each shape carries the convex parts that the physics takes for it. The draws of `rng` are what makes an instance.
    """
    bar, plate = rng.uniform(8, 14), rng.uniform(24, 34)  # radii
    length, thickness = rng.uniform(80, 120), rng.uniform(12, 20)
    grey, colour = (0.6, 0.6, 0.62), tuple(rng.uniform(0.1, 0.9, 3))
    handle = disc(bar, length).rotated("x", 90).moved(y=length / 2, z=plate)
    ends = [
        disc(plate, thickness, bevel=2).rotated("x", 90).moved(y=side * length / 2 + thickness / 2, z=plate)
        for side in (-1, 1)
    ]
    return [(handle, grey), *((end, colour) for end in ends)], float(rng.uniform(0.2, 0.4))


if __name__ == "__main__":
    from pecgrasp_env.capture import CaptureConfig, ObjectsConfig, generate, summarise

    objects = ObjectsConfig(classes=("08_own_object_class.dumbbell", "stapler"), instances_per_class=2)
    config = CaptureConfig(scenario="tabletop", objects=objects, samples_per_instance=10, sensor="d435")
    with tempfile.TemporaryDirectory() as folder:
        for row in summarise(generate(config, folder, workers=1))["classes"]:
            print(f"{row['class']}: {row['instances']} instances, {row['clouds']} clouds, points {row['points']}")
